#include "anigen/eval/transport/row_kernels.h"

#include <limits>

#include "anigen/core/kernel_form.h"

namespace anigen::eval::kernels {
namespace {

// The compiler may not reorder a minimum of doubles on its own; of several independent ones it keeps a vector.
constexpr int kLanes = 8;

ANIGEN_KERNEL_INLINE double least_of(const double* lanes) {
  double result = lanes[0];
  for (int k = 1; k < kLanes; ++k) result = lanes[k] < result ? lanes[k] : result;
  return result;
}

}  // namespace

ANIGEN_EXACT_KERNEL(double, relax,
                    (const double* __restrict costs, const double* __restrict potential, double offset, double number,
                     double* __restrict distance, double* __restrict previous, int n),
                    (costs, potential, offset, number, distance, previous, n)) {
  double lanes[kLanes];
  for (double& lane : lanes) lane = std::numeric_limits<double>::infinity();
  int j = 0;
  for (; j + kLanes <= n; j += kLanes) {
    for (int k = 0; k < kLanes; ++k) {
      const double through = costs[j + k] - potential[j + k] - offset, before = distance[j + k];
      previous[j + k] = through < before ? number : previous[j + k];
      const double now = through < before ? through : before;
      distance[j + k] = now;
      lanes[k] = now < lanes[k] ? now : lanes[k];
    }
  }
  for (; j < n; ++j) {
    const double through = costs[j] - potential[j] - offset;
    if (through < distance[j]) distance[j] = through, previous[j] = number;
    lanes[0] = distance[j] < lanes[0] ? distance[j] : lanes[0];
  }
  return least_of(lanes);
}

ANIGEN_EXACT_KERNEL(double, least, (const double* values, int n), (values, n)) {
  double lanes[kLanes];
  for (double& lane : lanes) lane = std::numeric_limits<double>::infinity();
  int j = 0;
  for (; j + kLanes <= n; j += kLanes) {
    for (int k = 0; k < kLanes; ++k) lanes[k] = values[j + k] < lanes[k] ? values[j + k] : lanes[k];
  }
  for (; j < n; ++j) lanes[0] = values[j] < lanes[0] ? values[j] : lanes[0];
  return least_of(lanes);
}

ANIGEN_EXACT_KERNEL(void, add_scaled, (double lever, const double* __restrict step, double* __restrict row, int n),
                    (lever, step, row, n)) {
  for (int k = 0; k < n; ++k) row[k] += lever * step[k];
}

}  // namespace anigen::eval::kernels
