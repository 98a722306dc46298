// The numbers of a material from a texture: a row for each slice; in it (spike, theta_d), then for each lobe
// (kappa, mean kappa), (gamma, mean gamma) and (beta, 1 / C).
uniform sampler2D u_parameters;

int dsbrdf_n_slices() { return textureSize(u_parameters, 0).y; }
int dsbrdf_n_lobes() { return textureSize(u_parameters, 0).x / 3; }
float dsbrdf_theta_d(int slice) { return texelFetch(u_parameters, ivec2(0, slice), 0).w; }
vec3 dsbrdf_spike(int slice) { return texelFetch(u_parameters, ivec2(0, slice), 0).xyz; }
vec3 dsbrdf_kappa(int slice, int k) { return texelFetch(u_parameters, ivec2(1 + 3 * k, slice), 0).xyz; }
vec3 dsbrdf_gamma(int slice, int k) { return texelFetch(u_parameters, ivec2(2 + 3 * k, slice), 0).xyz; }
vec3 dsbrdf_beta(int slice, int k) { return texelFetch(u_parameters, ivec2(3 + 3 * k, slice), 0).xyz; }
vec3 dsbrdf_sampling(int slice, int k) {
    return vec3(
        texelFetch(u_parameters, ivec2(1 + 3 * k, slice), 0).w,
        texelFetch(u_parameters, ivec2(2 + 3 * k, slice), 0).w,
        texelFetch(u_parameters, ivec2(3 + 3 * k, slice), 0).w);
}
