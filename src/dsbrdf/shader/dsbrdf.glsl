// The model in GLSL (1.30, 4.10, ES 3.00), as dsbrdf.model.evaluation and dsbrdf.model.sampling have it in Python.
//
//   vec3 dsbrdf_eval(vec3 wi, vec3 wo)     values, 1/sr, without the cosine
//   vec3 dsbrdf_sample(vec3 wo, vec3 u)    a direction toward the light, of three uniform numbers in [0, 1)
//   float dsbrdf_pdf(vec3 wi, vec3 wo)     density with which dsbrdf_sample draws wi, 1/sr
//
// wi and wo are unit vectors toward the light and the viewer in a frame whose z is the normal. A direction drawn
// below the horizon carries no light. In front of this text stand the numbers: constants, and the function
// dsbrdf_texel(i). texture.glsl of dsbrdf.shader says what the texels are: coefficients of curves over cos(theta_d), and
// the shares of the sampler.

const float DSBRDF_PI = 3.14159265358979;
// What is higher counts as that: the product of the two exponentials is a number in single precision
const float DSBRDF_MAX_LN_KAPPA = 3.77;
const float DSBRDF_MAX_EXPONENT = 40.0;

// exp(x) - 1 in full precision; a difference would vanish far from the peak of a lobe
vec3 dsbrdf_expm1(vec3 x) {
    vec3 series = x * (1.0 + x * (0.5 + x * (1.0 / 6.0 + x * (1.0 / 24.0 + x / 120.0))));
    return mix(exp(x) - 1.0, series, lessThan(abs(x), vec3(0.1)));
}

float dsbrdf_expm1(float x) {
    return dsbrdf_expm1(vec3(x)).x;
}

// ln cos(theta_h) = -artanh(sin2 / (1 + cos2)): a narrow lobe needs its relative precision near the pole
float dsbrdf_log_cos(float sin2, float cos2) {
    if (sin2 > 0.5) return 0.5 * log(max(cos2, 1e-16));
    float z = sin2 / (1.0 + cos2), z2 = z * z;
    return -z * (1.0 + z2 * (1.0 / 3.0 + z2 * (0.2 + z2 * (1.0 / 7.0 + z2 / 9.0))));
}

// Angle in [0, pi/2] of a right triangle; the built-in atan may be off by 4096 units in the last place
float dsbrdf_angle(float opposite, float adjacent) {
    float z = (opposite - adjacent) / (opposite + adjacent), a = abs(z);
    bool wide = a > 0.41421356;
    float t = wide ? (a - 1.0) / (a + 1.0) : a, t2 = t * t;
    float series = t * (1.0 - t2 * (1.0 / 3.0 - t2 * (0.2 - t2 * (1.0 / 7.0 - t2 * (1.0 / 9.0 - t2 / 11.0)))));
    float angle = wide ? 0.25 * DSBRDF_PI + series : series;
    return 0.25 * DSBRDF_PI + (z < 0.0 ? -angle : angle);
}

// sin^2 and ln cos of theta_h, theta_d and its cosine, and g cos(2 phi_d)
struct dsbrdf_Coordinates {
    float sin2;
    float log_cos;
    float theta_d;
    float cos_d;
    float azimuth;
};

dsbrdf_Coordinates dsbrdf_from_directions(vec3 wi, vec3 wo) {
    vec3 s = wi + wo, d = wi - wo;
    float rho2 = dot(s.xy, s.xy), s2 = rho2 + s.z * s.z;
    float sin2 = s2 > 0.0 ? rho2 / s2 : 1.0, cos2 = s2 > 0.0 ? s.z * s.z / s2 : 0.0;
    float along = d.z * d.z * s2, across = d.y * s.x - d.x * s.y;
    float both = along + across * across, width = DSBRDF_AZIMUTHAL_WIDTH * s.z;
    float root = sqrt(both) * sqrt(both + width * width * s2);
    float azimuth = root > 0.0 ? (along - across * across) / root : 0.0;
    return dsbrdf_Coordinates(
        sin2, dsbrdf_log_cos(sin2, cos2), dsbrdf_angle(length(d), sqrt(s2)), min(0.5 * sqrt(s2), 1.0), azimuth);
}

// The three functions of a curve of a given size that are not zero at x, and the first of them in index
vec3 dsbrdf_basis(int size, float x, out int index) {
    index = 0;
    if (size == 1) return vec3(1.0, 0.0, 0.0);
    if (size == 2) return vec3(1.0 - x, x, 0.0);
    int last = size - 3;
    float at = x * float(last + 1);
    index = clamp(int(at), 0, last);
    float u = at - float(index);
    float low = (1.0 - u) * (1.0 - u) * (index == 0 ? 1.0 : 0.5), high = u * u * (index == last ? 1.0 : 0.5);
    return vec3(low, 1.0 - low - high, high);
}

// Sum of the coefficients of a curve, one a texel, times these functions
vec4 dsbrdf_curve(int first, int size, float x) {
    int index;
    vec3 basis = dsbrdf_basis(size, x, index);
    vec4 value = basis.x * dsbrdf_texel(first + index);
    if (size > 1) value += basis.y * dsbrdf_texel(first + index + 1);
    if (size > 2) value += basis.z * dsbrdf_texel(first + index + 2);
    return value;
}

vec3 dsbrdf_eval(vec3 wi, vec3 wo) {
    if (wi.z < 0.0 || wo.z < 0.0) return vec3(0.0);
    dsbrdf_Coordinates at = dsbrdf_from_directions(wi, wo);
    ivec4 sizes = ivec4(dsbrdf_texel(0)), more = ivec4(dsbrdf_texel(1));
    int first = 2, most = more.y;
    vec3 value = vec3(0.0);
    for (int k = 0; k < more.z; ++k) {
        float scale = dsbrdf_curve(first, sizes.x, at.cos_d).x;
        float gamma = exp(dsbrdf_curve(first, sizes.y, at.cos_d).y);
        float beta = dsbrdf_curve(first, sizes.z, at.cos_d).z;
        float falloff = dsbrdf_curve(first, sizes.w, at.cos_d).w;
        vec3 colour = dsbrdf_curve(first + most, more.x, at.cos_d).xyz;
        vec3 power = exp(min(scale + colour + gamma * at.log_cos, DSBRDF_MAX_LN_KAPPA));
        value += dsbrdf_expm1(power) * exp(min(beta * at.azimuth + falloff * at.log_cos, DSBRDF_MAX_EXPONENT));
        first += 2 * most;
    }
    return value;
}

// The sampler's first texel for a direction
int dsbrdf_place(vec3 w) {
    ivec4 more = ivec4(dsbrdf_texel(1));
    float row = dsbrdf_angle(length(w.xy), w.z) * float(DSBRDF_N_ROWS - 1) / (0.5 * DSBRDF_PI) + 0.5;
    return 2 + 2 * more.y * more.z + 3 * int(row);
}

float dsbrdf_pdf(vec3 wi, vec3 wo) {
    if (wi.z <= 0.0 || wo.z <= 0.0) return 0.0;
    dsbrdf_Coordinates at = dsbrdf_from_directions(wi, wo);
    int place = dsbrdf_place(wo);
    float u = exp(at.log_cos), power = u, exponent = 1.0, of_half = 0.0, cosine = 0.0;
    for (int k = 0; k < 12; ++k) {
        float share = dsbrdf_texel(place + k / 4)[k % 4];
        if (k == 11) cosine = share;
        else of_half += share * (exponent + 2.0) * power;
        exponent *= 4.0;
        // Squaring doubles errors
        power = exponent == 1024.0 ? exp(exponent * at.log_cos) : power * power * power * power;
    }
    // A half vector or its image, whichever is turned toward wo
    vec3 s = wi + wo;
    float toward = 0.5 * length(s), image = max(s.z * wo.z / toward - toward, 0.0);
    return (cosine * wi.z + 0.25 * u * of_half / (toward + image)) / DSBRDF_PI;
}

// The built-in sine and cosine may be off by 2^-11, which must not change lengths
vec2 dsbrdf_circle(float u) {
    float phi = DSBRDF_PI * (2.0 * u - 1.0);
    return normalize(vec2(cos(phi), sin(phi)));
}

vec3 dsbrdf_sample(vec3 wo, vec3 u) {
    int place = dsbrdf_place(wo), k = 0;
    float x = u.x, share = 0.0, power = 1.0;
    for (; k < 11; ++k) {
        share = dsbrdf_texel(place + k / 4)[k % 4];
        if (x < share) break;
        x -= share;
        power *= 4.0;
    }
    bool cosine = k == 11;
    float sin2 = -dsbrdf_expm1(2.0 * log(1.0 - u.y) / (cosine ? 2.0 : power + 2.0));
    vec3 drawn = vec3(sqrt(sin2) * dsbrdf_circle(u.z), sqrt(max(1.0 - sin2, 0.0)));
    if (cosine) return drawn;
    // What is left of the first number decides between a half vector and its image at the other azimuth
    float toward = dot(wo, drawn), image = 2.0 * wo.z * drawn.z - toward;
    bool keep = x / share * (max(toward, 0.0) + max(image, 0.0)) < toward;
    vec3 half_vector = keep ? drawn : vec3(-drawn.xy, drawn.z);
    return 2.0 * (keep ? toward : image) * half_vector - wo;
}
