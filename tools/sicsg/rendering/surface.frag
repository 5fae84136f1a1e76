#version 450
// A surface under the light that was found at half size.
#include "geometry.glsl"
uniform vec3 eye;
uniform vec2 picture;            // width and height in pixels
uniform sampler2DArray tiles;    // square roots of linear RGB
uniform sampler2D geometry;      // at half size
uniform sampler2D white;         // at half size: radiance of a white surface
uniform sampler2D mirrored;      // at half size: radiance of a mirror
in vec3 v_world;
in vec3 v_normal;
in vec2 v_uv;
flat in vec4 v_colour;
flat in vec4 v_finish;
out vec4 out_radiance;

// Where to read the half size for a pixel: in between, or beside edges the one of four pixels that is most like it.
vec2 place_at_half(float mark) {
    vec2 size = vec2(textureSize(geometry, 0)), uv = gl_FragCoord.xy / picture;
    vec4 off = abs(textureGather(geometry, uv, 2) - mark);  // left below, right below, right above, left above
    float best = min(min(off.x, off.y), min(off.z, off.w));
    vec2 corner = floor(uv * size - 0.5);
    vec2 beside = vec2(best == off.y || best == off.z ? 1.0 : 0.0, best == off.x || best == off.y ? 1.0 : 0.0);
    bool edge = max(max(off.x, off.y), max(off.z, off.w)) > 0.03 * mark;
    return edge ? (corner + beside + 0.5) / size : uv;
}

void main() {
    float layer = v_finish.w;
    vec3 texel = texture(tiles, vec3(v_uv, max(layer, 0.0))).rgb;
    vec3 albedo = v_colour.rgb * (layer < 0.0 ? vec3(1.0) : texel * texel);
    vec3 normal = normalize(v_normal);
    vec2 place = place_at_half(surface_mark(normal, 1.0 / gl_FragCoord.w));
    vec3 radiance = albedo * ((1.0 - v_finish.y) * texture(white, place).rgb + v_colour.a);
#ifdef GLOSSY
    // Schlick's reflectance, less at grazing angles the rougher the surface (Lagarde, 2011).
    float facing = abs(dot(normalize(eye - v_world), normal));
    vec3 f0 = mix(vec3(0.04), albedo, v_finish.y), f90 = max(vec3(1.0 - v_finish.x), f0);
    radiance += (f0 + (f90 - f0) * pow(max(1.0 - facing, 0.0), 5.0)) * texture(mirrored, place).rgb;
#endif
    out_radiance = vec4(radiance, 1.0);
}
