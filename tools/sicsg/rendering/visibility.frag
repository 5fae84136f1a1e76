#version 450
// What each pixel sees, at half size: of the three shadow lights (r, g, b) and of the hemisphere over it (a).
// Sixteen patterns of few samples; smooth.frag takes their mean.
#include "geometry.glsl"
const int TAPS = 10;
const float RADIUS_M = 0.5;
const int SEARCHES = 4, FILTERS = 5, SUNBEAMS = 4;
uniform sampler2D geometry;
uniform mat4 cam_from_world;
uniform mat4 world_from_cam;
uniform vec4 rays;       // x/z and y/z of a place (u, v): rays.xy + rays.zw * place
uniform float focal;     // picture heights per unit of y/z
uniform mat4 shadow_from_world0;
uniform mat4 shadow_from_world1;
uniform mat4 shadow_from_world2;
uniform vec2 half_edges0;   // metres, of the rectangles
uniform vec2 half_edges1;
uniform vec2 half_edges2;
uniform sampler2D shadow0;
uniform sampler2D shadow1;
uniform sampler2D shadow2;   // the sun's, of parallel rays, where it shines
in vec2 v_place;
out vec4 out_seen;

vec3 in_camera(vec2 place, float depth) {
    return depth * vec3(rays.xy + rays.zw * place, 1.0);
}

// Point number i of a sequence that fills a square evenly (Roberts, 2018), shifted by the pattern.
vec2 scattered(int i, float pattern) {
    return 2.0 * fract(vec2(0.7548777, 0.5698403) * (float(i) + pattern)) - 1.0;
}

float depth_at(sampler2D shadow, vec2 uv) {
    return texelFetch(shadow, ivec2(uv * float(textureSize(shadow, 0).x)), 0).r;
}

// Share of a rectangle that a point sees: the rays to its points are followed through a map of depths from its centre,
// all at the mean depth of what is in between (Fernando, Percentage-Closer Soft Shadows, 2005).
float seen(sampler2D shadow, mat4 from_world, vec3 point, vec2 half_size, float pattern) {
    vec4 place = from_world * vec4(point, 1.0);
    float depth = place.w - 0.01;
    vec2 uv = 0.5 * place.xy / place.w + 0.5;
    if (place.w < 0.1 || any(greaterThan(abs(uv - 0.5), vec2(0.48)))) return 1.0;
    vec2 across = half_size / (2.0 * WIDE);
    float before = 0.0, found = 1e-4;
    for (int i = 0; i < SEARCHES; i++) {
        float reach = float(i + 1) / float(SEARCHES);  // mostly near by, so that what is low is not overlooked
        vec2 at = uv + 1.2 * reach * reach * across / depth * scattered(i, pattern);
        float hit = depth_at(shadow, clamp(at, 0.0, 0.999));
        float nearer = step(hit, depth);
        before += nearer * hit;
        found += nearer;
    }
    before = clamp(before / found, 0.3, depth);
    vec2 spread = across * (1.0 / before - 1.0 / depth);
    float lit = 0.0;
    for (int i = 0; i < FILTERS; i++)
        lit += step(depth, depth_at(shadow, clamp(uv + spread * scattered(i + SEARCHES, pattern), 0.0, 0.999)));
    return found < 0.5 ? 1.0 : lit / float(FILTERS);
}

float sunlit(vec3 point, float pattern) {
    vec3 place = (shadow_from_world2 * vec4(point, 1.0)).xyz * 0.5 + 0.5;
    if (any(greaterThan(abs(place.xy - 0.5), vec2(0.498)))) return 1.0;
    float lit = 0.0, texel = 1.0 / float(textureSize(shadow2, 0).x);
    for (int i = 0; i < SUNBEAMS; i++)
        lit += step(place.z, depth_at(shadow2, clamp(place.xy + 1.5 * texel * scattered(i, pattern), 0.0, 0.999)));
    return lit / float(SUNBEAMS);
}

// In the manner of McGuire, Osman, Bukowski and Hennessy, The Alchemy Screen-Space Ambient Obscurance, HPG 2011.
float open(vec3 point, vec3 normal, float pattern) {
    vec2 size = vec2(textureSize(geometry, 0));
    float reach = min(RADIUS_M * focal / point.z, 0.25), closed = 0.0;
    for (int i = 0; i < TAPS; i++) {
        float share = (float(i) + 0.5) / float(TAPS), angle = 6.2831853 * (share * 7.0 + pattern / 16.0);
        vec2 place = v_place + reach * share * share * vec2(cos(angle) * size.y / size.x, sin(angle));
        place = clamp(place, 0.0, 0.9999);
        vec3 gap = in_camera(place, texelFetch(geometry, ivec2(place * size), 0).w) - point;
        float distance2 = dot(gap, gap);
        float near = max(1.0 - distance2 / (RADIUS_M * RADIUS_M), 0.0);
        closed += near * max(dot(gap, normal) - 0.006 * point.z, 0.0) * inversesqrt(distance2 + 0.002);
    }
    return clamp(1.0 - 2.5 * closed / float(TAPS), 0.0, 1.0);
}

void main() {
    vec4 here = texelFetch(geometry, ivec2(gl_FragCoord.xy), 0);
    vec3 in_cam = in_camera(v_place, here.w);
    vec3 normal = mat3(cam_from_world) * unpacked_normal(here);
    normal = dot(normal, in_cam) > 0.0 ? -normal : normal;
    ivec2 cell = ivec2(gl_FragCoord.xy) & 3;
    float pattern = float((cell.x * 4 + cell.y * 7 + cell.x * cell.y * 3) & 15);
    vec3 point = (world_from_cam * vec4(in_cam + 0.02 * normal, 1.0)).xyz;
    out_seen = vec4(1.0, 1.0, 1.0, open(in_cam, normal, pattern));
#if SHADOWED > 0
    out_seen.r = seen(shadow0, shadow_from_world0, point, half_edges0, pattern);
#endif
#if SHADOWED > 1
    out_seen.g = seen(shadow1, shadow_from_world1, point, half_edges1, pattern);
#endif
#ifdef SUN
    out_seen.b = sunlit(point, pattern);
#elif SHADOWED > 2
    out_seen.b = seen(shadow2, shadow_from_world2, point, half_edges2, pattern);
#endif
}
