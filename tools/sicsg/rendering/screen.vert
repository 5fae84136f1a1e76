#version 450
// One triangle over the whole picture, at the far end.
in vec2 in_place;
out vec2 v_place;

void main() {
    v_place = 0.5 * in_place + 0.5;
    gl_Position = vec4(in_place, 1.0, 1.0);
}
