#version 450
#include "geometry.glsl"
in float v_depth;
in vec3 v_normal;
flat in float v_roughness;
out vec4 out_geometry;

void main() {
    out_geometry = packed_geometry(normalize(v_normal), v_roughness, v_depth);
}
