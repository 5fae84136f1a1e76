// Rectangles that shine to one side: lamps and windows.
struct Rectangle {
    vec4 centre;    // metres; w: strength, the radiance of a white surface that faces it 1 m away, times m^2
    vec4 normal;    // where it shines to; w: area over pi, m^2
    vec4 along;     // half of its first edge, metres; w: its length
    vec4 across;    // half of its second edge, metres; w: its length
    vec4 colour;    // linear RGB
    vec4 channel;   // 1 in the channel of the visibility that it has
};
layout(std140) uniform Rectangles { Rectangle rectangles[MAX_RECTANGLES]; };
