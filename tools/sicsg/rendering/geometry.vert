#version 450
// A vertex of a mesh with what the light on it depends on.
uniform mat4 world_from_mesh;
uniform mat3 world_from_normal;
uniform mat4 clip_from_world;
uniform vec4 depth_row;
uniform float outdoors;  // added to the roughness
in vec3 in_position;
in vec3 in_normal;
in vec4 in_finish;   // roughness, metallic, transmission, layer of the texture or -1
out float v_depth;
out vec3 v_normal;
flat out float v_roughness;

void main() {
    vec4 world = world_from_mesh * vec4(in_position, 1.0);
    v_depth = dot(depth_row, world);
    v_normal = world_from_normal * in_normal;
    v_roughness = in_finish.x + outdoors;
    gl_Position = clip_from_world * world;
}
