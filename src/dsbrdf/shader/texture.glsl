// The numbers of a material from a texture of floats (RGBA32F), as dsbrdf.shader.texels packs them: a row for each
// lobe, and in it, with m the greatest size of a curve,
//
//   column 0                      sizes of the curves: scale, gamma, beta, falloff
//   column 1                      size of the colour's curves in x
//   columns 2 to m + 1            coefficient 0, 1, ... of the four curves, padded with zeros
//   columns m + 2 to 2 m + 1      coefficient 0, 1, ... of the colour: red, green, blue
//   columns 2 m + 2 and on        two for each row of the sampler, at 0, 3, ... 90 degrees:
//                                 kappa, gamma, falloff, and the normaliser; then the lobe's share in x
//
// Coefficients are those of dsbrdf.model.lobes.Lobes, the sampler's numbers those of
// dsbrdf.model.sampling.SamplingTables. Any shares that add up to less than 1 are right; what is left is the share of
// cosine-weighted directions. The normaliser must be that of its kappa, gamma and falloff:
// 1 / (2 pi sum_n kappa^n / n! / (n gamma + falloff + 2)).
uniform sampler2D u_parameters;

int dsbrdf_n_lobes() { return textureSize(u_parameters, 0).y; }
int dsbrdf_n_columns() { return textureSize(u_parameters, 0).x; }
vec4 dsbrdf_texel(int lobe, int column) { return texelFetch(u_parameters, ivec2(column, lobe), 0); }
