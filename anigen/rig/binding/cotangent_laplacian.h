#pragma once
#include <cstdint>
#include <vector>

#include "anigen/rig/binding/welded_surface.h"

namespace anigen::rig {

/// The negative Laplace–Beltrami operator of a welded surface, −Δ = M⁻¹ L, in the unit frame. L is positive
/// semidefinite: (L w)_i = Σ_j c_ij (w_i − w_j), and L of a constant is 0.
struct CotangentLaplacian {
  struct Edge {
    std::int32_t a, b;   ///< places, a < b
    double conductance;  ///< c_ab = (cot α + cot β) / 2, summed over the faces at the edge, of which there may be any
                         ///< number
  };
  std::vector<Edge> edges;    ///< by (a, b), once each
  std::vector<double> areas;  ///< [P] diagonal of M: a third of the faces around each place
};

/// Faces with an angle below about 0.06° would drown the others in rounding: their cotangents are cut off at 1000 and
/// the negative ones left out, which keeps L semidefinite and what they join joined.
CotangentLaplacian cotangent_laplacian(const WeldedSurface& surface);

}  // namespace anigen::rig
