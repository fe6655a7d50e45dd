// Support regions by hpp-centroidal-dynamics, for comparison: extreme points along rays from one point.
// Built by benchmarks/bench_stability_peers.py where that library is installed; never part of the product.
#include <cmath>
#include <hpp/centroidal-dynamics/centroidal_dynamics.hh>

using namespace centroidal_dynamics;

extern "C" void *hpp_new(int generators) {
  return new Equilibrium("bench", 1.0, static_cast<unsigned>(generators), SOLVER_LP_QPOASES, true);
}

// Sets the contacts and walks `rays` rays from `start`; returns how many were solved, lengths in `out`.
extern "C" int hpp_region(void *object, int contacts, const double *position, const double *normal, double mu,
                          const double *start, int rays, const double *direction, double *out) {
  Equilibrium &e = *static_cast<Equilibrium *>(object);
  MatrixX3 p(contacts, 3), n(contacts, 3);
  for (int i = 0; i < contacts; ++i)
    for (int k = 0; k < 3; ++k) {
      p(i, k) = position[3 * i + k];
      n(i, k) = normal[3 * i + k];
    }
  if (!e.setNewContacts(p, n, mu, EQUILIBRIUM_ALGORITHM_DLP)) return -1;
  Vector3 origin(start[0], start[1], start[2]), com;
  int solved = 0;
  for (int k = 0; k < rays; ++k) {
    Vector3 a(direction[2 * k], direction[2 * k + 1], 0.0);
    if (e.findExtremumOverLine(a, origin, 0.0, com) == LP_STATUS_OPTIMAL) {
      ++solved;
      out[k] = (com - origin).dot(a);
    } else {
      out[k] = std::nan("");
    }
  }
  return solved;
}
