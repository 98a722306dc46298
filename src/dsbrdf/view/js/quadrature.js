// Nodes over half vectors, as dsbrdf.geometry.directions has them: panels that shrink toward the pole meet lobes of any
// width.

const LEGENDRE = [
  [-0.8611363115940526, 0.3478548451374539],
  [-0.3399810435848563, 0.6521451548625461],
  [0.3399810435848563, 0.6521451548625461],
  [0.8611363115940526, 0.3478548451374539],
];
const FIRST = 1e-4;

/** theta_h and weights, which hold its sine. */
export function halfAngles(nPanels) {
  const growth = (Math.PI / 2 / FIRST) ** (1 / (nPanels - 1));
  const edges = [0, ...Array.from({ length: nPanels }, (_, i) => FIRST * growth ** i)];
  return edges.slice(1).flatMap((high, i) => {
    const width = high - edges[i];
    return LEGENDRE.map(([node, weight]) => {
      const thetaH = edges[i] + 0.5 * width * (node + 1);
      return { thetaH, weight: 0.5 * width * weight * Math.sin(thetaH) };
    });
  });
}

/**
 * What follows from a direction at thetaI and a half vector at thetaH and the azimuth phi beside it: the cosines of the
 * difference angle and of the other direction, and cos(2 phi_d); null where one of the directions is not above the horizon.
 */
export function reflected(thetaI, thetaH, phi) {
  const cosD = Math.sin(thetaH) * Math.cos(phi) * Math.sin(thetaI) + Math.cos(thetaH) * Math.cos(thetaI);
  const cosO = 2 * cosD * Math.cos(thetaH) - Math.cos(thetaI);
  if (cosD <= 0 || cosO <= 0) return null;
  const thetaD = Math.acos(Math.min(cosD, 1));
  const sines = Math.sin(thetaH) * Math.sin(thetaD);
  const cosPhiD = sines > 1e-12 ? (Math.cos(thetaH) * cosD - Math.cos(thetaI)) / sines : 0;
  return { cosD, cosO, thetaD, cos2Phi: 2 * Math.min(1, cosPhiD * cosPhiD) - 1 };
}
