// Values, samples and densities, as dsbrdf.model.evaluation and dsbrdf.model.sampling have them in Python.
//
//   dsbrdf_eval(wi, wo)     values of red, green and blue, 1/sr, without the cosine
//   dsbrdf_sample(wo, u)    a direction toward the light, of a vector of three uniform numbers in [0, 1)
//   dsbrdf_pdf(wi, wo)      density with which dsbrdf_sample draws wi, 1/sr
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
float dsbrdf_expm1(float x) {
    if (abs(x) < 0.1) {
        return x * (1.0 + x * (0.5 + x * (1.0 / 6.0 + x * (1.0 / 24.0 + x / 120.0))));
    }
    return exp(x) - 1.0;
}

// ln cos(theta_h) = -artanh(sin2 / (1 + cos2)): a narrow lobe needs its relative precision near the pole
float dsbrdf_log_cos(float sin2, float cos2) {
    if (sin2 > 0.5) {
        return 0.5 * log(max(cos2, 1e-16));
    }
    float z = sin2 / (1.0 + cos2);
    float z2 = z * z;
    return -z * (1.0 + z2 * (1.0 / 3.0 + z2 * (0.2 + z2 * (1.0 / 7.0 + z2 / 9.0))));
}

// Angle in [0, pi/2] of a right triangle; the built-in atan may be off by 4096 units in the last place
float dsbrdf_angle(float opposite, float adjacent) {
    float z = (opposite - adjacent) / (opposite + adjacent);
    float a = abs(z);
    float first = 0.0;
    float t = a;
    if (a > 0.41421356) {
        first = 0.25 * DSBRDF_PI;
        t = (a - 1.0) / (a + 1.0);
    }
    float t2 = t * t;
    float series = t * (1.0 - t2 * (1.0 / 3.0 - t2 * (0.2 - t2 * (1.0 / 7.0 - t2 * (1.0 / 9.0 - t2 / 11.0)))));
    return 0.25 * DSBRDF_PI + sign(z) * (first + series);
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
    vec3 s = wi + wo;
    vec3 d = wi - wo;
    float rho2 = dot(s.xy, s.xy);
    float s2 = rho2 + s.z * s.z;
    dsbrdf_Coordinates at;
    at.sin2 = 1.0;
    at.log_cos = dsbrdf_log_cos(1.0, 0.0);
    if (s2 > 0.0) {
        at.sin2 = rho2 / s2;
        at.log_cos = dsbrdf_log_cos(at.sin2, s.z * s.z / s2);
    }
    at.theta_d = dsbrdf_angle(length(d), sqrt(s2));
    at.cos_d = min(0.5 * sqrt(s2), 1.0);
    float along = d.z * d.z * s2;
    float across = d.y * s.x - d.x * s.y;
    float both = along + across * across;
    float width = DSBRDF_AZIMUTHAL_WIDTH * s.z;
    float root = sqrt(both) * sqrt(both + width * width * s2);
    at.azimuth = 0.0;
    if (root > 0.0) {
        at.azimuth = (along - across * across) / root;
    }
    return at;
}

// The three functions of a curve of a given size that are not zero at x, and, last, the number of the first of them
vec4 dsbrdf_basis(int size, float x) {
    if (size == 1) {
        return vec4(1.0, 0.0, 0.0, 0.0);
    }
    if (size == 2) {
        return vec4(1.0 - x, x, 0.0, 0.0);
    }
    int last = size - 3;
    float place = x * float(last + 1);
    int index = clamp(int(place), 0, last);
    float u = place - float(index);
    float low = 0.5 * (1.0 - u) * (1.0 - u);
    float high = 0.5 * u * u;
    if (index == 0) {
        low = 2.0 * low;
    }
    if (index == last) {
        high = 2.0 * high;
    }
    return vec4(low, 1.0 - low - high, high, float(index));
}

// Sum of the coefficients of a curve, one a texel, times these functions
vec4 dsbrdf_curve(int first, int size, float x) {
    vec4 basis = dsbrdf_basis(size, x);
    int index = first + int(basis.w);
    vec4 value = basis.x * dsbrdf_texel(index);
    if (size > 1) {
        value += basis.y * dsbrdf_texel(index + 1);
    }
    if (size > 2) {
        value += basis.z * dsbrdf_texel(index + 2);
    }
    return value;
}

vec3 dsbrdf_eval(vec3 wi, vec3 wo) {
    vec3 value = vec3(0.0, 0.0, 0.0);
    if (wi.z < 0.0 || wo.z < 0.0) {
        return value;
    }
    dsbrdf_Coordinates at = dsbrdf_from_directions(wi, wo);
    ivec4 sizes = ivec4(dsbrdf_texel(0));
    ivec4 more = ivec4(dsbrdf_texel(1));
    for (int k = 0; k < more.z; ++k) {
        int first = 2 + 2 * more.y * k;
        float scale = dsbrdf_curve(first, sizes.x, at.cos_d).x;
        float gamma = exp(dsbrdf_curve(first, sizes.y, at.cos_d).y);
        float beta = dsbrdf_curve(first, sizes.z, at.cos_d).z;
        float falloff = dsbrdf_curve(first, sizes.w, at.cos_d).w;
        vec3 colour = dsbrdf_curve(first + more.y, more.x, at.cos_d).xyz;
        vec3 limit = vec3(DSBRDF_MAX_LN_KAPPA, DSBRDF_MAX_LN_KAPPA, DSBRDF_MAX_LN_KAPPA);
        vec3 power = exp(min(colour + (scale + gamma * at.log_cos), limit));
        vec3 lobe = vec3(dsbrdf_expm1(power.x), dsbrdf_expm1(power.y), dsbrdf_expm1(power.z));
        value += lobe * exp(min(beta * at.azimuth + falloff * at.log_cos, DSBRDF_MAX_EXPONENT));
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
    if (wi.z <= 0.0 || wo.z <= 0.0) {
        return 0.0;
    }
    dsbrdf_Coordinates at = dsbrdf_from_directions(wi, wo);
    int place = dsbrdf_place(wo);
    float u = exp(at.log_cos);
    float power = u;
    float exponent = 1.0;
    float light = 0.0;
    for (int k = 0; k < 11; ++k) {
        vec4 shares = dsbrdf_texel(place + k / 4);
        light += shares[k % 4] * (exponent + 2.0) * power;
        exponent = 4.0 * exponent;
        power = power * power * power * power;
        // Squaring doubles errors
        if (exponent == 1024.0) {
            power = exp(exponent * at.log_cos);
        }
    }
    float cosine = dsbrdf_texel(place + 2).w;
    // A half vector or its image, whichever is turned toward wo
    vec3 s = wi + wo;
    float toward = 0.5 * length(s);
    float image = max(s.z * wo.z / toward - toward, 0.0);
    return (cosine * wi.z + 0.25 * u * light / (toward + image)) / DSBRDF_PI;
}

// The built-in sine and cosine may be off by 2^-11, which must not change lengths
vec2 dsbrdf_circle(float u) {
    float phi = DSBRDF_PI * (2.0 * u - 1.0);
    return normalize(vec2(cos(phi), sin(phi)));
}

vec3 dsbrdf_sample(vec3 wo, vec3 u) {
    int place = dsbrdf_place(wo);
    float x = u.x;
    float share = 0.0;
    float power = 1.0;
    int chosen = 11;
    for (int k = 0; k < 11; ++k) {
        vec4 shares = dsbrdf_texel(place + k / 4);
        share = shares[k % 4];
        if (x < share) {
            chosen = k;
            break;
        }
        x = x - share;
        power = 4.0 * power;
    }
    float exponent = power + 2.0;
    if (chosen == 11) {
        exponent = 2.0;
    }
    float sin2 = -dsbrdf_expm1(2.0 * log(1.0 - u.y) / exponent);
    vec2 around = sqrt(sin2) * dsbrdf_circle(u.z);
    vec3 drawn = vec3(around.x, around.y, sqrt(max(1.0 - sin2, 0.0)));
    if (chosen == 11) {
        return drawn;
    }
    // What is left of the first number decides between a half vector and its image at the other azimuth
    float toward = dot(wo, drawn);
    float image = 2.0 * wo.z * drawn.z - toward;
    if (x / share * (max(toward, 0.0) + max(image, 0.0)) < toward) {
        return 2.0 * toward * drawn - wo;
    }
    return 2.0 * image * vec3(-drawn.x, -drawn.y, drawn.z) - wo;
}
