#version 450
// A vertex without a surface: for shadow maps, ids and depth. The row gives the depth, of a camera the z-depth in metres.
uniform mat4 world_from_mesh;
uniform mat4 clip_from_world;
uniform vec4 depth_row;
in vec3 in_position;
out float v_depth;

void main() {
    vec4 world = world_from_mesh * vec4(in_position, 1.0);
    v_depth = dot(depth_row, world);
    gl_Position = clip_from_world * world;
}
