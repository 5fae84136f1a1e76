#version 450
// Distance before a lamp in metres, or place along the sun's rays, as a colour that shaders read.
in float v_depth;
out float out_depth;

void main() {
    out_depth = v_depth;
}
