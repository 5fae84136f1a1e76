// What lies around: the uniform light of a room, and outside a sky that is bluer above and brighter about the sun, and
// ground.
uniform float sky;
uniform float sun;
uniform vec3 sun_direction;
const vec3 SUNLIGHT = vec3(1.0, 0.93, 0.82);

vec3 surround(vec3 direction, vec3 ambient) {
    return ambient * (0.9 + 0.25 * direction.z);
}

vec3 outside(vec3 direction) {
    vec3 above = mix(vec3(1.0, 1.0, 0.98), vec3(0.55, 0.75, 1.1), smoothstep(0.0, 0.7, direction.z));
    vec3 below = mix(vec3(0.42, 0.40, 0.36), vec3(0.30, 0.29, 0.27), smoothstep(0.0, -0.4, direction.z));
    vec3 colour = mix(below, above, smoothstep(-0.01, 0.01, direction.z));
    float glow = pow(max(dot(direction, sun_direction), 0.0), 8.0);
    return sky * colour + 0.15 * sun * glow * SUNLIGHT;
}

// Distribution (Trowbridge-Reitz) and visibility (Hammon's fit) of GGX for one direction, widened by the light's size.
float glint(vec3 normal, vec3 view, vec3 towards, float alpha, float wide) {
    float cos_half = max(dot(normal, normalize(towards + view)), 0.0);
    float cos_light = max(dot(normal, towards), 0.0), cos_view = max(dot(normal, view), 1e-3);
    float d = cos_half * cos_half * (alpha * alpha - 1.0) + 1.0;
    float shine = alpha * alpha * alpha * alpha / (wide * wide * d * d);
    return min(shine * cos_light / (2.0 * mix(2.0 * cos_light * cos_view, cos_light + cos_view, alpha) + 1e-3), 40.0);
}
