// Values at pairs of directions, two texels a pair, to be read back as floats.

uniform sampler2D u_pairs;

out vec4 result;

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy) * ivec2(2, 1);
    result = vec4(dsbrdf_eval(texelFetch(u_pairs, at, 0).xyz, texelFetch(u_pairs, at + ivec2(1, 0), 0).xyz), 1.0);
}
