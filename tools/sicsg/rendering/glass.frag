#version 450
// A pane: the reflection of the surroundings is added, what is behind is multiplied by the second output.
#include "surround.glsl"
uniform vec3 eye;
uniform vec3 ambient;
in vec3 v_world;
in vec3 v_normal;
flat in vec4 v_colour;
flat in vec4 v_finish;
layout(location = 0, index = 0) out vec4 out_radiance;
layout(location = 0, index = 1) out vec4 out_passed;

void main() {
    vec3 view = normalize(eye - v_world), normal = normalize(v_normal);
    normal = dot(normal, view) < 0.0 ? -normal : normal;
    float fresnel = 0.04 + 0.96 * pow(1.0 - clamp(dot(normal, view), 0.0, 1.0), 5.0);
    vec3 around = mix(surround(reflect(-view, normal), ambient), outside(reflect(-view, normal)), 0.1);
    around += sun * SUNLIGHT * glint(normal, view, sun_direction, 0.05, 0.05) * 0.2;
    out_radiance = vec4(fresnel * around + (1.0 - v_finish.z) * v_colour.rgb * surround(normal, ambient), 1.0);
    out_passed = vec4(v_finish.z * (1.0 - fresnel) * v_colour.rgb, 1.0);
}
