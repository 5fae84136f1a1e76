#version 450
// The light that arrives at each pixel at half size: what a white surface there sends on, and what a mirror of its
// roughness would show of lamps, windows, sun and surroundings.
#include "surround.glsl"
#include "rectangles.glsl"
#include "geometry.glsl"
uniform sampler2D geometry;
uniform sampler2D visible;       // of three lights, and of the hemisphere
uniform vec3 ambient;
uniform vec3 skylight;           // in place of the ambient light, outdoors
uniform vec4 rays;               // x/z and y/z of a place (u, v): rays.xy + rays.zw * place
uniform mat4 world_from_cam;
in vec2 v_place;
layout(location = 0) out vec4 out_white;
layout(location = 1) out vec4 out_mirrored;

// Share of its light that a rectangle sends to where it is seen at this slope (sine): upwards a window sends only what
// the ground outside reflects, and houses hide a part of the sky.
float sent(Rectangle r, float slope) {
    return r.normal.z < -0.5 ? 1.0 : mix(0.15, 0.8, smoothstep(-0.4, 0.6, slope));
}

// Radiance of a white surface.
vec3 diffuse_of(Rectangle r, vec3 point, vec3 normal) {
    vec3 gap = r.centre.xyz - point;
    float distance2 = dot(gap, gap), inverse = inversesqrt(distance2);
    float leaves = max(-dot(r.normal.xyz, gap) * inverse, 0.0);
    float wrap = min(0.5 * r.normal.w * inverse * inverse, 0.4);
    float arrives = max((dot(normal, gap) * inverse + wrap) / (1.0 + wrap), 0.0);
    float shown = r.centre.w / (distance2 + r.normal.w) * sent(r, gap.z * inverse);
    return r.colour.rgb * (shown * leaves * arrives);
}

// The mirrored part at reflectance 1, from the rectangle's point nearest to the mirrored view (Karis, Real Shading in
// Unreal Engine 4, 2013).
vec3 mirrored_of(Rectangle r, vec3 point, vec3 normal, vec3 view, vec3 mirrored, float alpha) {
    vec3 gap = r.centre.xyz - point;
    float meets = dot(r.normal.xyz, gap) / min(dot(r.normal.xyz, mirrored), -1e-3);
    vec3 off = mirrored * meets - gap;
    float a = clamp(dot(off, r.along.xyz) / (r.along.w * r.along.w), -1.0, 1.0);
    float b = clamp(dot(off, r.across.xyz) / (r.across.w * r.across.w), -1.0, 1.0);
    vec3 towards = gap + a * r.along.xyz + b * r.across.xyz;
    float distance2 = dot(towards, towards);
    float wide = min(alpha + 0.5 * sqrt(r.normal.w / distance2), 1.0);
    float lit = r.centre.w / (distance2 + r.normal.w) * step(0.0, -dot(r.normal.xyz, towards));
    towards *= inversesqrt(distance2);
    float shown = min(lit * glint(normal, view, towards, alpha, wide), r.centre.w / r.normal.w);
    return r.colour.rgb * (shown * sent(r, towards.z));
}

void main() {
    vec4 here = texelFetch(geometry, ivec2(gl_FragCoord.xy), 0);
    vec4 seen = texelFetch(visible, ivec2(gl_FragCoord.xy), 0);
    seen.rgb *= mix(1.0, seen.a, 0.6);  // what is too near to an edge for a shadow map
    vec3 ray = mat3(world_from_cam) * vec3(rays.xy + rays.zw * v_place, 1.0);
    vec3 point = world_from_cam[3].xyz + here.w * ray, view = -normalize(ray), normal = unpacked_normal(here);
    normal = dot(normal, view) < 0.0 ? -normal : normal;
    vec3 mirrored = reflect(-view, normal);
    float marked = unpacked_roughness(here);
    bool outdoors = marked > 1.5;
    float roughness = outdoors ? marked - 2.0 : marked, alpha = max(roughness * roughness, 0.03);
    vec3 around = outdoors ? skylight : ambient;
    vec3 white = surround(normal, around) * seen.a, shine = surround(mirrored, around) * seen.a;
#define LIT_BY(i) { \
        float share = dot(seen, rectangles[i].channel); \
        white += share * diffuse_of(rectangles[i], point, normal); \
        shine += share * mirrored_of(rectangles[i], point, normal, view, mirrored, alpha); \
    }
    EACH_RECTANGLE(LIT_BY)
#ifdef SUN
    white += sun * SUNLIGHT * max(dot(normal, sun_direction), 0.0) * seen.b;
    shine += sun * SUNLIGHT * seen.b * glint(normal, view, sun_direction, alpha, alpha);
#endif
    out_white = vec4(white, 1.0);
    out_mirrored = vec4(shine, 1.0);
}
