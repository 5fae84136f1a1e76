// The geometry at half size in one texel: x, y: normal, folded onto a square (Cigolle et al., A Survey of Efficient
// Representations for Independent Unit Vectors, 2014), x plus 4 times the roughness in steps of 1/64; z: a number that
// tells surfaces apart; w: z-depth in metres.
vec2 other_side(vec2 n) {
    return (1.0 - abs(n.yx)) * vec2(n.x < 0.0 ? -1.0 : 1.0, n.y < 0.0 ? -1.0 : 1.0);
}

// Differs across an edge, be it one of depth or one where the normal turns.
float surface_mark(vec3 normal, float depth) {
    return depth * (1.0 + 0.3 * dot(normal, vec3(0.36, 0.58, 0.73)));
}

vec4 packed_geometry(vec3 normal, float roughness, float depth) {
    vec3 n = normal / (abs(normal.x) + abs(normal.y) + abs(normal.z));
    vec2 folded = n.z < 0.0 ? other_side(n.xy) : n.xy;
    return vec4(folded.x + 4.0 * round(64.0 * roughness), folded.y, surface_mark(normal, depth), depth);
}

float unpacked_roughness(vec4 geometry) {
    return round(geometry.x / 4.0) / 64.0;
}

vec3 unpacked_normal(vec4 geometry) {
    vec2 folded = vec2(geometry.x - 4.0 * round(geometry.x / 4.0), geometry.y);
    float z = 1.0 - abs(folded.x) - abs(folded.y);
    return normalize(vec3(z < 0.0 ? other_side(folded) : folded, z));
}
