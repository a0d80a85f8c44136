#pragma once
#include <cstddef>
#include <limits>
#include <optional>
#include <vector>

namespace anigen::train {

/// Clips the gradient's norm at a percentile of the recent norms (reference training-and-data.md, section 2.5).
///
/// The threshold starts at max_norm (or none). Once `buffer_size` finite norms were seen it is, from the next call
/// on, the percentile of the last `buffer_size` unclipped norms, and never above max_norm.
class AdaptiveGradClipper {
 public:
  struct Options {
    std::optional<double> max_norm;
    double clip_percentile = 95.0;
    std::size_t buffer_size = 1000;
  };
  /// All that a resumed run needs.
  struct State {
    std::vector<float> buffer;  ///< [buffer_size], ring
    double threshold = std::numeric_limits<double>::infinity();
    std::size_t pointer = 0, length = 0;
  };

  explicit AdaptiveGradClipper(const Options& options);

  /// @param norm L2 norm over all gradients, before clipping
  /// @return the factor min(1, threshold / (norm + 1e-6)) that the gradients must be multiplied with: 0 for an
  ///         infinite norm, NaN for a NaN
  double update(double norm);

  double threshold() const { return state_.threshold; }
  const State& state() const { return state_; }
  /// @throws InputError when the state was saved with another buffer size
  void restore(const State& state);

 private:
  Options options_;
  State state_;
};

}  // namespace anigen::train
