#version 450
// Mean over four cells of the pattern of visibility.frag along one axis, not across edges of depth.
uniform sampler2D seen;
uniform sampler2D geometry;
uniform ivec2 along;
out vec4 out_seen;

void main() {
    ivec2 here = ivec2(gl_FragCoord.xy), last = textureSize(seen, 0) - 1;
    float depth = texelFetch(geometry, here, 0).w, weights = 1e-4;
    vec4 total = 1e-4 * texelFetch(seen, here, 0);
    for (int i = -2; i < 2; i++) {
        ivec2 there = clamp(here + i * along, ivec2(0), last);
        float weight = max(1.0 - abs(texelFetch(geometry, there, 0).w - depth) / (0.03 * depth), 0.0);
        total += weight * texelFetch(seen, there, 0);
        weights += weight;
    }
    out_seen = total / weights;
}
