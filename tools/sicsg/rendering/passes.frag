#version 450
uniform int entity;
in float v_depth;
layout(location = 0) out int out_entity;
layout(location = 1) out float out_depth;

void main() {
    out_entity = entity;
    out_depth = v_depth;
}
