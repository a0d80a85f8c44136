#include "anigen/eval/align/plain_icp.h"

#include <cmath>
#include <limits>
#include <string>

#include "anigen/core/error.h"
#include "anigen/eval/align/procrustes.h"

namespace anigen::eval {

IcpState plain_icp(const std::vector<Eigen::Vector3d>& source, const NearestPointFunction& nearest,
                   const Similarity& start, int max_iterations, double threshold, bool similarity) {
  if (source.empty()) throw InputError("", "points", "there is no point to align");
  for (std::size_t i = 0; i < source.size(); ++i) {
    if (!source[i].allFinite()) throw InputError("", "points[" + std::to_string(i) + "]", "the position is not finite");
  }
  const auto count = static_cast<double>(source.size());
  IcpState state;
  state.transform = start;
  double before = std::numeric_limits<double>::infinity();
  std::vector<Eigen::Vector3d> goals(source.size());
  while (state.iterations < max_iterations) {
    ProcrustesSums sums;
    for (std::size_t i = 0; i < source.size(); ++i) {
      goals[i] = nearest(state.transform(source[i]));
      sums.add(source[i], goals[i]);
    }
    state.transform = sums.solve(similarity ? PairScale::kLeastSquares : PairScale::kFixed);
    ++state.iterations;
    double squared = 0.0;
    for (std::size_t i = 0; i < source.size(); ++i) squared += (state.transform(source[i]) - goals[i]).squaredNorm();
    state.residual = std::sqrt(squared / count);
    if (before - squared / count < threshold) break;
    before = squared / count;
  }
  return state;
}

}  // namespace anigen::eval
