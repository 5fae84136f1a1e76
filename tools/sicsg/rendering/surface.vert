#version 450
// A vertex of a mesh in the world; positions in metres.
uniform mat4 world_from_mesh;
uniform mat3 world_from_normal;
uniform mat4 clip_from_world;
in vec3 in_position;
in vec3 in_normal;
in vec2 in_uv;
in vec4 in_colour;   // albedo, emission
in vec4 in_finish;   // roughness, metallic, transmission, layer of the texture or -1
out vec3 v_world;
out vec3 v_normal;
out vec2 v_uv;
flat out vec4 v_colour;
flat out vec4 v_finish;

void main() {
    vec4 world = world_from_mesh * vec4(in_position, 1.0);
    v_world = world.xyz;
    v_normal = world_from_normal * in_normal;
    v_uv = in_uv;
    v_colour = in_colour;
    v_finish = in_finish;
    gl_Position = clip_from_world * world;
}
