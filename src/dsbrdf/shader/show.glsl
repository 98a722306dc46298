// The mean of the samples as a picture: exposure, the transfer curve of sRGB, and a dither of one step against bands.

uniform sampler2D u_sum;
uniform float u_exposure;
uniform float u_scale;   // pixels of the samples for one of the picture

out vec4 result;

vec3 to_srgb(vec3 x) {
    x = clamp(x, 0.0, 1.0);
    return mix(1.055 * pow(x, vec3(1.0 / 2.4)) - 0.055, 12.92 * x, lessThan(x, vec3(0.0031308)));
}

// The mean at a place in the samples: between four of them where there are fewer than pixels
vec3 mean_at(vec2 place) {
    ivec2 last = textureSize(u_sum, 0) - 1, low = clamp(ivec2(floor(place)), ivec2(0), last);
    ivec2 high = min(low + 1, last);
    vec2 t = clamp(place - vec2(low), 0.0, 1.0);
    vec4 below = mix(texelFetch(u_sum, low, 0), texelFetch(u_sum, ivec2(high.x, low.y), 0), t.x);
    vec4 above = mix(texelFetch(u_sum, ivec2(low.x, high.y), 0), texelFetch(u_sum, high, 0), t.x);
    vec4 sum = mix(below, above, t.y);
    return sum.rgb / max(sum.a, 1.0);
}

void main() {
    float noise = fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(0.06711056, 0.00583715))));
    vec3 shown = to_srgb(u_exposure * mean_at(gl_FragCoord.xy * u_scale - 0.5));
    result = vec4(shown + (noise - 0.5) / 255.0, 1.0);
}
