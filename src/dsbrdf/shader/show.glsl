// The mean of the samples as a picture: exposure, the transfer curve of sRGB, and a dither of one step against bands.

uniform sampler2D u_sum;
uniform float u_exposure;

out vec4 result;

vec3 to_srgb(vec3 x) {
    x = clamp(x, 0.0, 1.0);
    return mix(1.055 * pow(x, vec3(1.0 / 2.4)) - 0.055, 12.92 * x, lessThan(x, vec3(0.0031308)));
}

void main() {
    vec4 sum = texelFetch(u_sum, ivec2(gl_FragCoord.xy), 0);
    float noise = fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(0.06711056, 0.00583715))));
    vec3 shown = to_srgb(u_exposure * sum.rgb / max(sum.a, 1.0));
    result = vec4(shown + (noise - 0.5) / 255.0, 1.0);
}
