// One more set of samples of each pixel: a unit sphere seen from outside, lit from afar, light reflected once.
//
// Directions are world ones, y up. Each pair of samples is one of the material and one of the environment's bright
// texels, weighed against each other by the power heuristic (Veach and Guibas 1995), so that neither a small lamp on
// a rough material nor a mirror leaves fireflies.

uniform sampler2D u_sum;           // what was added up so far: radiance, and the number of samples
uniform sampler2D u_environment;   // radiance, equirectangular
uniform sampler2D u_light;         // of each texel: share of the row before it, of the rows before (column 0), density
// Measured values, a row for each theta_d, columns evenly in the square root of theta_h from 0 to 90 degrees: first the
// means, with 1 in alpha where there is one, then as many amplitudes, with theta_d in alpha
uniform sampler2D u_profile;
uniform mat3 u_camera;             // right, up and back of the viewer
uniform mat3 u_to_environment;
uniform vec3 u_point_light;        // direction toward it, for u_lighting 2
uniform vec2 u_resolution;
uniform float u_distance;          // of the viewer from the centre
uniform float u_half_width;        // of the picture's shorter side, at distance 1
uniform float u_flat;              // radiance for u_lighting 1
uniform int u_lighting;            // 0 the environment, 1 the same from everywhere, 2 a point at infinity
uniform int u_n_pairs;
uniform int u_n_before;            // samples so far
uniform bool u_measured;

out vec4 result;

// A whole number for each pixel (PCG; Jarzynski and Olano 2020)
uvec4 hashed(uvec4 v) {
    v = v * 1664525u + 1013904223u;
    v += v.yzxy * v.wxyz;
    v ^= v >> 16u;
    v += v.yzxy * v.wxyz;
    return v;
}

// Numbers in [0, 1) that fill a square or a cube evenly (Roberts 2018), shifted at random in each pixel
uvec4 shift_material, shift_light, shift_pixel;

float unit(uint x) {
    return float(x >> 8u) / 16777216.0;
}

vec2 evenly2(uint i, uvec4 shift) {
    return vec2(unit(shift.x + i * 3242174889u), unit(shift.y + i * 2447445414u));
}

vec3 evenly3(uint i, uvec4 shift) {
    return vec3(
        unit(shift.x + i * 3518319155u), unit(shift.y + i * 2882110345u), unit(shift.z + i * 2360945575u));
}

// Directions d are those of the environment, before it is turned
vec2 environment_uv(vec3 d) {
    return vec2(atan(d.x, -d.z) / (2.0 * DSBRDF_PI), acos(clamp(d.y, -1.0, 1.0)) / DSBRDF_PI);
}

vec3 environment(vec2 uv) {
    return textureLod(u_environment, uv, 0.0).rgb;
}

// Density of sample_environment, 1/sr
float environment_pdf(vec2 uv, vec3 d) {
    ivec2 size = textureSize(u_light, 0);
    ivec2 texel = clamp(ivec2(vec2(fract(uv.x), uv.y) * vec2(size)), ivec2(0), size - 1);
    return texelFetch(u_light, texel, 0).z / (2.0 * DSBRDF_PI * DSBRDF_PI * max(length(d.xz), 1e-6));
}

// Share before a row (of all rows) or before a texel (of its row); 1 at the end
float light_row(int row) {
    return row < textureSize(u_light, 0).y ? texelFetch(u_light, ivec2(0, row), 0).y : 1.0;
}

float light_column(int column, int row) {
    return column < textureSize(u_light, 0).x ? texelFetch(u_light, ivec2(column, row), 0).x : 1.0;
}

// A place (u, v) with the density of its texel, by inversion: first the row, then the column
vec2 sample_environment(vec2 u) {
    ivec2 low = ivec2(0), high = textureSize(u_light, 0);
    while (high.y - low.y > 1) {
        int middle = (low.y + high.y) / 2;
        if (light_row(middle) <= u.y) low.y = middle;
        else high.y = middle;
    }
    while (high.x - low.x > 1) {
        int middle = (low.x + high.x) / 2;
        if (light_column(middle, low.y) <= u.x) low.x = middle;
        else high.x = middle;
    }
    vec2 before = vec2(light_column(low.x, low.y), light_row(low.y));
    vec2 share = vec2(light_column(low.x + 1, low.y), light_row(low.y + 1)) - before;
    return (vec2(low) + clamp((u - before) / max(share, 1e-30), 0.0, 1.0)) / vec2(textureSize(u_light, 0));
}

vec3 environment_direction(vec2 uv) {
    vec2 polar = dsbrdf_circle(0.5 * uv.y + 0.5), around = dsbrdf_circle(uv.x + 0.5);
    return vec3(polar.y * around.y, polar.x, -polar.y * around.x);
}

// Two vectors that make a frame with the normal (Duff et al. 2017)
mat3 frame(vec3 n) {
    float side = n.z < 0.0 ? -1.0 : 1.0, a = -1.0 / (side + n.z), b = n.x * n.y * a;
    return mat3(vec3(1.0 + side * n.x * n.x * a, side * b, -side * n.x), vec3(b, side + n.y * n.y * a, -n.y), n);
}

// theta_d of a row of measured values
float profile_theta_d(int row) {
    return texelFetch(u_profile, ivec2(textureSize(u_profile, 0).x / 2, row), 0).a;
}

// The measured mean and amplitude of a row where there are any, else the model
vec3 profile_value(int row, float place, float azimuth, vec3 fitted) {
    int n = textureSize(u_profile, 0).x / 2, i = min(int(place), n - 2);
    float t = place - float(i);
    vec4 mean = mix(texelFetch(u_profile, ivec2(i, row), 0), texelFetch(u_profile, ivec2(i + 1, row), 0), t);
    vec4 wave = mix(texelFetch(u_profile, ivec2(n + i, row), 0), texelFetch(u_profile, ivec2(n + i + 1, row), 0), t);
    return mix(fitted, max(mean.rgb + wave.rgb * azimuth, 0.0), mean.a);
}

vec3 reflectance(vec3 wi, vec3 wo) {
    vec3 fitted = dsbrdf_eval(wi, wo);
    if (!u_measured) return fitted;
    dsbrdf_Coordinates at = dsbrdf_from_directions(wi, wo);
    float place = sqrt(asin(sqrt(min(at.sin2, 1.0))) / (0.5 * DSBRDF_PI))
        * float(textureSize(u_profile, 0).x / 2 - 1);
    int low = 0, high = textureSize(u_profile, 0).y - 1;
    while (high - low > 1) {
        int middle = (low + high) / 2;
        if (profile_theta_d(middle) <= at.theta_d) low = middle;
        else high = middle;
    }
    float below = profile_theta_d(low), gap = profile_theta_d(high) - below;
    float weight = gap > 0.0 ? clamp((at.theta_d - below) / gap, 0.0, 1.0) : 0.0;
    return mix(
        profile_value(low, place, at.azimuth, fitted), profile_value(high, place, at.azimuth, fitted), weight);
}

float power_heuristic(float of_this, float of_other) {
    float a = of_this * of_this, b = of_other * of_other;
    return a > 0.0 ? a / (a + b) : 0.0;
}

vec3 material_sample(vec3 wo, mat3 to_world, vec3 u) {
    vec3 wi = dsbrdf_sample(wo, u);
    if (wi.z <= 0.0) return vec3(0.0);
    float density = dsbrdf_pdf(wi, wo);
    if (density <= 0.0) return vec3(0.0);
    vec3 value = reflectance(wi, wo) * wi.z / density;
    if (u_lighting == 1) return value * u_flat;
    vec3 toward = u_to_environment * (to_world * wi);
    vec2 uv = environment_uv(toward);
    return value * environment(uv) * power_heuristic(density, environment_pdf(uv, toward));
}

vec3 light_sample(vec3 wo, mat3 to_world, vec2 u) {
    vec2 uv = sample_environment(u);
    vec3 toward = environment_direction(uv), wi = (toward * u_to_environment) * to_world;
    float density = environment_pdf(uv, toward);
    if (wi.z <= 0.0 || density <= 0.0) return vec3(0.0);
    float weight = power_heuristic(density, dsbrdf_pdf(wi, wo));
    return reflectance(wi, wo) * environment(uv) * (wi.z * weight / density);
}

vec3 background(vec3 direction) {
    if (u_lighting == 0) return environment(environment_uv(u_to_environment * direction));
    return vec3(u_lighting == 1 ? u_flat : 0.0);
}

vec3 radiance(vec2 pixel, uint i) {
    vec2 at = (2.0 * pixel - u_resolution) / min(u_resolution.x, u_resolution.y) * u_half_width;
    vec3 ray = u_camera * normalize(vec3(at, -1.0)), eye = u_camera[2] * u_distance;
    float along = -dot(ray, eye), root = along * along - u_distance * u_distance + 1.0;
    if (root < 0.0) return background(ray);
    vec3 normal = normalize(eye + (along - sqrt(root)) * ray);
    mat3 to_world = frame(normal);
    vec3 wo = -ray * to_world;
    if (u_lighting == 2) {
        vec3 wi = u_point_light * to_world;
        return DSBRDF_PI * max(wi.z, 0.0) * reflectance(wi, wo);
    }
    vec3 value = material_sample(wo, to_world, evenly3(i, shift_material));
    if (u_lighting == 1) return value;
    return value + light_sample(wo, to_world, evenly2(i, shift_light));
}

void main() {
    uvec2 pixel = uvec2(gl_FragCoord.xy);
    shift_material = hashed(uvec4(pixel, 1u, 0u));
    shift_light = hashed(uvec4(pixel, 2u, 0u));
    shift_pixel = hashed(uvec4(pixel, 3u, 0u));
    vec4 sum = texelFetch(u_sum, ivec2(pixel), 0);
    for (int k = 0; k < u_n_pairs; ++k) {
        uint i = uint(u_n_before + k);
        sum += vec4(radiance(vec2(pixel) + evenly2(i, shift_pixel), i), 1.0);
    }
    result = sum;
}
