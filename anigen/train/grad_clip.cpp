#include "anigen/train/grad_clip.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/percentile.h"

namespace anigen::train {

AdaptiveGradClipper::AdaptiveGradClipper(const Options& options) : options_(options) {
  if (options.buffer_size == 0) throw InputError("", "buffer_size", "must be at least 1");
  if (!(options.clip_percentile >= 0.0 && options.clip_percentile <= 100.0)) {
    throw InputError("", "clip_percentile", "must lie in [0, 100]");
  }
  if (options.max_norm && !(*options.max_norm > 0.0)) throw InputError("", "max_norm", "must be positive");
  state_.buffer.assign(options.buffer_size, 0.0f);
  if (options.max_norm) state_.threshold = *options.max_norm;
}

double AdaptiveGradClipper::update(double norm) {
  // Not std::min: a NaN must reach the gradients, so that the update is seen to be bad.
  const double ratio = state_.threshold / (norm + 1e-6);
  const double factor = ratio > 1.0 ? 1.0 : ratio;
  if (!std::isfinite(norm)) return factor;
  state_.buffer[state_.pointer] = static_cast<float>(norm);
  state_.pointer = (state_.pointer + 1) % options_.buffer_size;
  state_.length = std::min(state_.length + 1, options_.buffer_size);
  if (state_.length == options_.buffer_size) {
    state_.threshold = percentile(state_.buffer, options_.clip_percentile);
    if (options_.max_norm) state_.threshold = std::min(state_.threshold, *options_.max_norm);
  }
  return factor;
}

void AdaptiveGradClipper::restore(const State& state) {
  if (state.buffer.size() != options_.buffer_size || state.pointer >= options_.buffer_size ||
      state.length > options_.buffer_size) {
    throw InputError("", "grad_clip",
                     "saved with a buffer of " + std::to_string(state.buffer.size()) + " norms, configured with " +
                         std::to_string(options_.buffer_size));
  }
  state_ = state;
}

}  // namespace anigen::train
