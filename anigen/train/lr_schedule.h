#pragma once
#include <cstdint>
#include <memory>
#include <vector>

namespace anigen::train {

/// Learning rate as a closed form of the step (0 = first update), so that resuming needs no state. Names and
/// defaults are those of torch.optim.lr_scheduler; reference training-and-data.md, section 2.6.
class LrSchedule {
 public:
  virtual ~LrSchedule() = default;
  /// @param base the optimiser's learning rate
  virtual double rate(double base, std::int64_t step) const = 0;
};

using LrSchedulePtr = std::shared_ptr<const LrSchedule>;

/// base, always: what "lr_scheduler": null means.
LrSchedulePtr unscheduled();

/// base · (start + (end − start) · min(step, total) / total)
LrSchedulePtr linear_lr(double start_factor, double end_factor, std::int64_t total_iters);

/// eta_min + (base − eta_min) · (1 + cos(π · step / T_max)) / 2. Past T_max the rate comes back up, as torch's does.
LrSchedulePtr cosine_annealing_lr(std::int64_t t_max, double eta_min);

/// base · factor until total, then base
LrSchedulePtr constant_lr(double factor, std::int64_t total_iters);

/// base · gamma^(number of milestones reached); milestones in any order
LrSchedulePtr multi_step_lr(std::vector<std::int64_t> milestones, double gamma);

/// base · min(1, (step + 1) / warmup)
LrSchedulePtr linear_warmup_lr(std::int64_t warmup_steps);

/// Schedule i runs from milestones[i − 1] (0 for the first) on, counting its own steps from there.
/// @throws InputError unless there is one milestone fewer than schedules and they do not decrease
LrSchedulePtr sequential_lr(std::vector<LrSchedulePtr> schedules, std::vector<std::int64_t> milestones);

}  // namespace anigen::train
