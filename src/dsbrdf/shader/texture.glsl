// The numbers of a material from a texture of floats (RGBA32F), one row of texels as dsbrdf.shader.texels packs them; with
// m the greatest size of a curve,
//
//   0                 sizes of the curves: scale, gamma, beta, falloff
//   1                 size of the colour's curves, m, number of lobes
//   then 2 m a lobe   coefficient 0, 1, ... of the four curves, padded with zeros to m texels,
//                     coefficient 0, 1, ... of the colour, red, green, blue, padded likewise
//   then 3 a row of the sampler, at 0, 3, ... 90 degrees of the known direction:
//                     shares of the eleven powers of dsbrdf.model.sampling, and of cosine-weighted directions
//
// Coefficients are those of dsbrdf.model.lobes.Lobes. Any shares that add up to 1 are right, the better ones have less
// noise; a mean of those of two materials suits what lies between them.
uniform sampler2D u_parameters;

vec4 dsbrdf_texel(int i) { return texelFetch(u_parameters, ivec2(i, 0), 0); }
