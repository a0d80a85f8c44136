#include "anigen/train/lr_schedule.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen::train {
namespace {

void require_positive(std::int64_t value, const char* name) {
  if (value < 1) throw InputError("", name, "must be at least 1, is " + std::to_string(value));
}

struct Unscheduled final : LrSchedule {
  double rate(double base, std::int64_t) const override { return base; }
};

struct Linear final : LrSchedule {
  double start, end;
  std::int64_t total;
  Linear(double s, double e, std::int64_t t) : start(s), end(e), total(t) {}
  double rate(double base, std::int64_t step) const override {
    const double done = static_cast<double>(std::min(step, total)) / static_cast<double>(total);
    return base * (start + (end - start) * done);
  }
};

struct Cosine final : LrSchedule {
  std::int64_t t_max;
  double eta_min;
  Cosine(std::int64_t t, double e) : t_max(t), eta_min(e) {}
  double rate(double base, std::int64_t step) const override {
    const double angle = kPi * static_cast<double>(step % (2 * t_max)) / static_cast<double>(t_max);
    return eta_min + (base - eta_min) * 0.5 * (1.0 + std::cos(angle));
  }
};

struct Constant final : LrSchedule {
  double factor;
  std::int64_t total;
  Constant(double f, std::int64_t t) : factor(f), total(t) {}
  double rate(double base, std::int64_t step) const override { return step < total ? base * factor : base; }
};

struct MultiStep final : LrSchedule {
  MultiStep(std::vector<std::int64_t> at, double factor) : milestones(std::move(at)), gamma(factor) {}
  double rate(double base, std::int64_t step) const override {
    const auto reached = std::count_if(milestones.begin(), milestones.end(), [&](auto at) { return at <= step; });
    return base * std::pow(gamma, static_cast<double>(reached));
  }
  std::vector<std::int64_t> milestones;
  double gamma;
};

struct Warmup final : LrSchedule {
  std::int64_t steps;
  explicit Warmup(std::int64_t s) : steps(s) {}
  double rate(double base, std::int64_t step) const override {
    return base * std::min(1.0, static_cast<double>(step + 1) / static_cast<double>(steps));
  }
};

struct Sequential final : LrSchedule {
  std::vector<LrSchedulePtr> schedules;
  std::vector<std::int64_t> milestones;
  double rate(double base, std::int64_t step) const override {
    const auto i =
        static_cast<std::size_t>(std::upper_bound(milestones.begin(), milestones.end(), step) - milestones.begin());
    return schedules[i]->rate(base, i == 0 ? step : step - milestones[i - 1]);
  }
};

}  // namespace

LrSchedulePtr unscheduled() { return std::make_shared<Unscheduled>(); }

LrSchedulePtr linear_lr(double start_factor, double end_factor, std::int64_t total_iters) {
  require_positive(total_iters, "total_iters");
  return std::make_shared<Linear>(start_factor, end_factor, total_iters);
}

LrSchedulePtr cosine_annealing_lr(std::int64_t t_max, double eta_min) {
  require_positive(t_max, "T_max");
  return std::make_shared<Cosine>(t_max, eta_min);
}

LrSchedulePtr constant_lr(double factor, std::int64_t total_iters) {
  if (total_iters < 0) throw InputError("", "total_iters", "must not be negative");
  return std::make_shared<Constant>(factor, total_iters);
}

LrSchedulePtr multi_step_lr(std::vector<std::int64_t> milestones, double gamma) {
  return std::make_shared<MultiStep>(std::move(milestones), gamma);
}

LrSchedulePtr linear_warmup_lr(std::int64_t warmup_steps) {
  require_positive(warmup_steps, "warmup_steps");
  return std::make_shared<Warmup>(warmup_steps);
}

LrSchedulePtr sequential_lr(std::vector<LrSchedulePtr> schedules, std::vector<std::int64_t> milestones) {
  if (schedules.empty() || milestones.size() + 1 != schedules.size()) {
    throw InputError("", "milestones",
                     std::to_string(schedules.size()) + " schedules need one milestone fewer, not " +
                         std::to_string(milestones.size()));
  }
  if (!std::is_sorted(milestones.begin(), milestones.end()) || (!milestones.empty() && milestones.front() < 0)) {
    throw InputError("", "milestones", "must not be negative and must not decrease");
  }
  auto sequence = std::make_shared<Sequential>();
  sequence->schedules = std::move(schedules);
  sequence->milestones = std::move(milestones);
  return sequence;
}

}  // namespace anigen::train
