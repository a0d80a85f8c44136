#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <variant>
#include <vector>

#include "anigen/train/ema.h"
#include "anigen/train/grad_clip.h"
#include "anigen/train/lr_schedule.h"
#include "anigen/train/muon.h"
#include "anigen/train/optimizer.h"
#include "anigen/train/parameter_buffer.h"
#include "anigen/train/recovery_point.h"

namespace anigen::train {

struct UpdateOptions {
  AdamW::Options optimizer;
  std::optional<Muon::Options> muon;  ///< set: weight matrices are updated by Muon, the rest by AdamW
  LrSchedulePtr schedule = unscheduled();
  std::variant<std::monostate, double, AdaptiveGradClipper::Options> grad_clip;  ///< none, fixed norm, adaptive
  std::vector<double> ema_rates{0.9999};
  bool loss_scaling = false;  ///< fp16 on CUDA; fp32 needs none
  double fp16_scale_growth = 1e-3;
};

/// What happens to the parameters after the last backward pass of a step: unscale, clip, AdamW, recovery from weights
/// that are not finite, averages, learning rate, loss scale (reference training-and-data.md, section 2.4, steps 3 to
/// 8).
class ParameterUpdate {
 public:
  /// @param buffer must outlive this; its values at this moment start the averages
  ParameterUpdate(ParameterBuffer& buffer, const UpdateOptions& options);

  /// Losses must be multiplied with this before backward(): 2^log_scale, or 1 without loss scaling.
  double loss_scale() const;

  struct Result {
    double grad_norm = 0.0;  ///< of the unscaled gradients, before clipping
    double lr = 0.0;         ///< used, or what would have been used, in this step
    bool skipped = false;    ///< gradients not finite; parameters unchanged (log_scale went down)
    bool restored = false;   ///< the update left weights that are not finite; those of recovery.step() are back
  };
  /// @pre buffer.collect_gradients() was called. The averages and the schedule advance also on a skipped update.
  /// @throws Error when weights are not finite and there are none to go back to
  Result apply(std::int64_t step);

  AdamW optimizer;
  std::optional<Muon> muon;
  std::optional<AdaptiveGradClipper> clipper;
  Ema ema;
  RecoveryPoint recovery;
  double log_scale = 15.0;

 private:
  double clip_factor(double norm);

  ParameterBuffer& buffer_;
  UpdateOptions options_;
};

}  // namespace anigen::train
