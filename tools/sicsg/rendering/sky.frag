#version 450
#include "surround.glsl"
uniform mat3 world_from_place;  // direction of a place (x, y, 1) of the picture
in vec2 v_place;
out vec4 out_radiance;

void main() {
    out_radiance = vec4(outside(normalize(world_from_place * vec3(v_place, 1.0))), 1.0);
}
