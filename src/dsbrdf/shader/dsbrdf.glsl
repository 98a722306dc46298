// The model in GLSL (1.30, 4.10, ES 3.00), as dsbrdf.model.evaluation and dsbrdf.model.sampling have it in Python.
//
//   vec3 dsbrdf_eval(vec3 wi, vec3 wo)     values, 1/sr, without the cosine
//   vec3 dsbrdf_sample(vec3 wo, vec3 u)    a direction toward the light, of three uniform numbers in [0, 1)
//   float dsbrdf_pdf(vec3 wi, vec3 wo)     density with which dsbrdf_sample draws wi, 1/sr
//
// wi and wo are unit vectors toward the light and the viewer in a frame whose z is the normal. A direction drawn
// below the horizon carries no light. In front of this text stand the numbers: constants, and the functions
// dsbrdf_n_slices, dsbrdf_n_lobes, dsbrdf_theta_d, dsbrdf_kappa, dsbrdf_gamma, dsbrdf_beta, dsbrdf_spike and
// dsbrdf_sampling (kappa, gamma and 1 / C of a lobe, channels averaged).

const float DSBRDF_PI = 3.14159265358979;

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

// sin^2 and ln cos of theta_h, theta_d, and g cos(2 phi_d)
struct dsbrdf_Coordinates {
    float sin2;
    float log_cos;
    float theta_d;
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
        sin2, dsbrdf_log_cos(sin2, cos2), dsbrdf_angle(length(d), sqrt(s2)), azimuth);
}

// Shape of a spike
float dsbrdf_cap(float sin2) {
    return max(1.0 - sin2 / DSBRDF_SIN2_WIDTH, 0.0);
}

vec3 dsbrdf_slice_value(int slice, dsbrdf_Coordinates at) {
    vec3 value = dsbrdf_spike(slice) * dsbrdf_cap(at.sin2);
    for (int k = 0; k < dsbrdf_n_lobes(); ++k) {
        vec3 lobe = dsbrdf_expm1(dsbrdf_kappa(slice, k) * exp(dsbrdf_gamma(slice, k) * at.log_cos));
        value += lobe * (1.0 + dsbrdf_beta(slice, k) * at.azimuth);
    }
    return value;
}

// Slice at or below theta_d, never the last of several
int dsbrdf_find_slice(float theta_d) {
    int low = 0, high = dsbrdf_n_slices() - 1;
    while (high - low > 1) {
        int middle = (low + high) / 2;
        if (dsbrdf_theta_d(middle) <= theta_d) low = middle;
        else high = middle;
    }
    return low;
}

// The share of the upper of two slices
float dsbrdf_weight(int low, int high, float theta_d) {
    float at = dsbrdf_theta_d(low), step = dsbrdf_theta_d(high) - at;
    return step > 0.0 ? clamp((theta_d - at) / step, 0.0, 1.0) : 0.0;
}

vec3 dsbrdf_eval(vec3 wi, vec3 wo) {
    if (wi.z < 0.0 || wo.z < 0.0) return vec3(0.0);
    dsbrdf_Coordinates at = dsbrdf_from_directions(wi, wo);
    int low = dsbrdf_find_slice(at.theta_d), high = min(low + 1, dsbrdf_n_slices() - 1);
    float weight = dsbrdf_weight(low, high, at.theta_d);
    return (1.0 - weight) * dsbrdf_slice_value(low, at) + weight * dsbrdf_slice_value(high, at);
}

// The slice that dsbrdf_sample draws from: theta_d is not known yet
int dsbrdf_nearest_slice(vec3 wo) {
    float theta = dsbrdf_angle(length(wo.xy), wo.z);
    int low = dsbrdf_find_slice(theta), high = min(low + 1, dsbrdf_n_slices() - 1);
    return dsbrdf_weight(low, high, theta) > 0.5 ? high : low;
}

// Integral of the spike over half vectors, channels averaged; that of a lobe is 1 / C
float dsbrdf_spike_integral(int slice) {
    return dot(dsbrdf_spike(slice), vec3(1.0 / 3.0)) * 0.5 * DSBRDF_PI * DSBRDF_SIN2_WIDTH;
}

float dsbrdf_integral(int slice) {
    float total = dsbrdf_spike_integral(slice);
    for (int k = 0; k < dsbrdf_n_lobes(); ++k) total += dsbrdf_sampling(slice, k).z;
    return total;
}

float dsbrdf_pdf(vec3 wi, vec3 wo) {
    if (wi.z <= 0.0 || wo.z <= 0.0) return 0.0;
    dsbrdf_Coordinates at = dsbrdf_from_directions(wi, wo);
    int slice = dsbrdf_nearest_slice(wo);
    float of_half = dot(dsbrdf_spike(slice), vec3(1.0 / 3.0)) * dsbrdf_cap(at.sin2) * sqrt(1.0 - at.sin2);
    for (int k = 0; k < dsbrdf_n_lobes(); ++k) {
        vec3 lobe = dsbrdf_sampling(slice, k);
        of_half += dsbrdf_expm1(lobe.x * exp(lobe.y * at.log_cos));
    }
    // |wi + wo| is twice the cosine of theta_d
    float of_lobes = of_half / max(dsbrdf_integral(slice) * 2.0 * length(wi + wo), 1e-30);
    return mix(of_lobes, wi.z / DSBRDF_PI, DSBRDF_COSINE_SHARE);
}

// sin^2 of theta_h of a half vector drawn from a lobe, by u in (0, 1] and x in [0, 1 / C): the power series of exp
// makes the lobe a sum of powers of the cosine
float dsbrdf_sample_lobe(vec3 lobe, float x, float u) {
    float rest = x / (2.0 * DSBRDF_PI), power = lobe.x, n = 1.0;
    while (n < 200.0 && rest >= power / (n * lobe.y + 1.0)) {
        rest -= power / (n * lobe.y + 1.0);
        n += 1.0;
        power *= lobe.x / n;
    }
    return -dsbrdf_expm1(2.0 * log(u) / (n * lobe.y + 1.0));
}

float dsbrdf_sample_sin2(int slice, float x, float u) {
    x *= dsbrdf_integral(slice);
    for (int k = 0; k < dsbrdf_n_lobes(); ++k) {
        vec3 lobe = dsbrdf_sampling(slice, k);
        if (x < lobe.z) return dsbrdf_sample_lobe(lobe, x, u);
        x -= lobe.z;
    }
    return DSBRDF_SIN2_WIDTH * (1.0 - sqrt(u));
}

// The built-in sine and cosine may be off by 2^-11, which must not change lengths
vec2 dsbrdf_circle(float u) {
    float phi = DSBRDF_PI * (2.0 * u - 1.0);
    return normalize(vec2(cos(phi), sin(phi)));
}

vec3 dsbrdf_sample(vec3 wo, vec3 u) {
    bool cosine = u.x < DSBRDF_COSINE_SHARE;
    float x = (u.x - DSBRDF_COSINE_SHARE) / (1.0 - DSBRDF_COSINE_SHARE);
    float sin2 = cosine ? u.y : dsbrdf_sample_sin2(dsbrdf_nearest_slice(wo), x, 1.0 - u.y);
    vec3 drawn = vec3(sqrt(sin2) * dsbrdf_circle(u.z), sqrt(max(1.0 - sin2, 0.0)));
    return cosine ? drawn : 2.0 * dot(wo, drawn) * drawn - wo;
}
