#include "anigen/flow/sampler.h"

#include <algorithm>
#include <limits>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/nn/attention_windows.h"
#include "anigen/nn/condition_cache.h"

namespace anigen::flow {

namespace {

constexpr std::int64_t kMaxSteps = 100000;
constexpr std::int64_t kMostWindow = 1 << 16;

void check_streams(const Streams& streams, const Streams& like, const char* what) {
  TORCH_CHECK(streams.size() == like.size(), what, " has ", streams.size(), " streams, the state ", like.size());
  for (std::size_t i = 0; i < streams.size(); ++i) {
    TORCH_CHECK(streams[i].sizes() == like[i].sizes(), what, " of stream ", i, " has shape ", streams[i].sizes(),
                ", the state ", like[i].sizes());
  }
}

bool guided_at(const SamplerOptions& options, double t) {
  return !options.cfg_interval || (options.cfg_interval->first <= t && t <= options.cfg_interval->second);
}

// x − Δt v
Streams moved(const Streams& x, const Streams& velocity, double span) {
  Streams result;
  for (std::size_t i = 0; i < x.size(); ++i) result.push_back(x[i] - span * velocity[i]);
  return result;
}

// a + w (b − a)
Streams on_line(const Streams& a, const Streams& b, double w) {
  Streams result;
  for (std::size_t i = 0; i < a.size(); ++i) result.push_back(a[i] + w * (b[i] - a[i]));
  return result;
}

// Largest ‖a − b‖ / ‖b‖ of a stream.
double relative_difference(const Streams& a, const Streams& b) {
  double largest = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double norm = b[i].norm().item<double>(), off = (a[i] - b[i]).norm().item<double>();
    if (off > 0.0) largest = std::max(largest, norm > 0.0 ? off / norm : std::numeric_limits<double>::infinity());
  }
  return largest;
}

// Velocities of the model along a sampling, with what earlier steps let it spare.
class GuidedVelocity {
 public:
  GuidedVelocity(const Velocities& velocities, const SamplerOptions& options)
      : velocities_(velocities), options_(options) {}

  std::int64_t passes() const { return passes_; }

  /// Begins anew: earlier velocities were those of another attention, or guided otherwise.
  void forget() {
    difference_.clear();
    known_.clear();
    error_ = std::numeric_limits<double>::infinity();
    predicted_last_ = false;
  }

  /// Velocity at the beginning of a step, predicted or asked for.
  Streams of_step(const Streams& x, double t, bool last) {
    if (options_.velocity_tolerance <= 0.0) return at(x, t, /*begins_step=*/true);
    const bool two = known_.size() == 2;
    const double w = two ? (t - known_[0].t) / (known_[1].t - known_[0].t) : 0.0;
    if (two && !last && !predicted_last_ && error_ <= options_.velocity_tolerance) {
      predicted_last_ = true;
      return on_line(known_[0].velocity, known_[1].velocity, w);
    }
    const Streams velocity = at(x, t, /*begins_step=*/true);
    if (two) error_ = relative_difference(on_line(known_[0].velocity, known_[1].velocity, w), velocity);
    predicted_last_ = false;
    known_.push_back({t, velocity});
    if (known_.size() > 2) known_.erase(known_.begin());
    return velocity;
  }

  /// Velocity at any time, asked for. @param begins_step counts for cfg_every; else the last difference serves
  Streams at(const Streams& x, double t, bool begins_step = false) {
    const auto time = static_cast<float>(kTimeScale * t);
    Streams velocity = velocities_.conditional(x, time);
    ++passes_;
    check_streams(velocity, x, "the velocity");
    if (!velocities_.unconditional || !guided_at(options_, t)) return velocity;
    const bool asks =
        difference_.empty() || options_.cfg_every == 1 || (begins_step && since_asked_ >= options_.cfg_every);
    if (begins_step) since_asked_ = asks ? 1 : since_asked_ + 1;
    if (!asks) {
      for (std::size_t i = 0; i < x.size(); ++i) velocity[i] = velocity[i] + options_.cfg_strength * difference_[i];
      return velocity;
    }
    const Streams negative = velocities_.unconditional(x, time);
    ++passes_;
    check_streams(negative, x, "the unconditional velocity");
    difference_.clear();
    for (std::size_t i = 0; i < x.size(); ++i) {  // v ← (1 + s) v − s v_neg
      if (options_.cfg_every > 1) difference_.push_back(velocity[i] - negative[i]);
      velocity[i] = (1.0 + options_.cfg_strength) * velocity[i] - options_.cfg_strength * negative[i];
    }
    return velocity;
  }

 private:
  struct Known {
    double t;
    Streams velocity;
  };

  const Velocities& velocities_;
  const SamplerOptions& options_;
  std::int64_t passes_ = 0, since_asked_ = 0;
  Streams difference_;        // v − v_neg of the last unconditional pass
  std::vector<Known> known_;  // the last two that were asked for at the beginning of a step
  double error_ = std::numeric_limits<double>::infinity();  // of predicting the last one
  bool predicted_last_ = false;
};

// The step before, for Adams–Bashforth.
struct EarlierStep {
  Streams velocity;
  double span = 0.0;
};

/// Result of one step. @param first the velocity at x and t @param before none in the first step
Streams step_from(const Streams& x, const Streams& first, double t, double next, const EarlierStep& before,
                  GuidedVelocity& velocities, const SamplerOptions& options) {
  const double span = t - next;               // Δt = t − t'
  if (options.solver == Solver::kMidpoint) {  // x − Δt v(x − ½ Δt v, t − ½ Δt)
    return moved(x, velocities.at(moved(x, first, 0.5 * span), t - 0.5 * span), span);
  }
  if (options.solver == Solver::kAdams && !before.velocity.empty()) {
    // v + ½ Δt / Δt₋₁ (v − v₋₁): half way along the line through both velocities
    return moved(x, on_line(before.velocity, first, 1.0 + 0.5 * span / before.span), span);
  }
  const Streams end = moved(x, first, span);  // Euler: x_t' = x_t − Δt v(x_t, t)
  if (options.solver != Solver::kHeun || next <= 0.0) return end;
  const Streams second = velocities.at(end, next);
  Streams mean;  // Heun: ½ (v(x_t, t) + v(x_t', t'))
  for (std::size_t i = 0; i < x.size(); ++i) mean.push_back(0.5 * (first[i] + second[i]));
  return moved(x, mean, span);
}

void keep_known(Streams& x, double t, const Inpainting& known, double sigma_min) {
  for (std::size_t i = 0; i < x.size(); ++i)
    x[i] = x[i] * (1.0 - known.mask[i]) + noisy(known.x_0[i], known.noise[i], t, sigma_min) * known.mask[i];
}

const std::vector<std::pair<std::string, Solver>>& solver_names() {
  static const std::vector<std::pair<std::string, Solver>> kNames = {// in the order of Solver
                                                                     {"euler", Solver::kEuler},
                                                                     {"midpoint", Solver::kMidpoint},
                                                                     {"heun", Solver::kHeun},
                                                                     {"adams", Solver::kAdams}};
  return kNames;
}

}  // namespace

const std::string& word_of(Solver solver) { return solver_names()[static_cast<std::size_t>(solver)].first; }

Solver parse_solver(const std::string& word) {
  for (const auto& [name, solver] : solver_names()) {
    if (word == name) return solver;
  }
  throw InputError("", "solver", "expected euler, midpoint, heun or adams, found '" + word + "'");
}

void SamplerOptions::fields(ConfigFields& f) {
  f("steps", steps, {1, kMaxSteps});
  if (!f.writes() || solver != Solver::kEuler) f("solver", solver, solver_names());
  f("rescale_t", rescale_t);
  f("cfg_strength", cfg_strength);
  std::vector<double> ends;
  if (cfg_interval) ends = {cfg_interval->first, cfg_interval->second};
  if (!f.writes() || cfg_interval) f("cfg_interval", ends);
  if (f.reads() && f.reader().has("cfg_interval")) {
    if (ends.size() != 2) throw f.error("cfg_interval", "expected the two ends of an interval of t");
    cfg_interval = {ends[0], ends[1]};
  }
  f("sigma_min", sigma_min);
  if (!f.writes() || cfg_every != 1) f("cfg_every", cfg_every, {1, kMaxSteps});
  if (!f.writes() || velocity_tolerance > 0.0) f("velocity_tolerance", velocity_tolerance, {0.0, 1.0});
  if (!f.writes() || windowed_steps > 0) f("windowed_steps", windowed_steps, {0, kMaxSteps});
  if (!f.writes() || window != SamplerOptions().window) f("window", window, {1, kMostWindow});
}

void SamplerOptions::validate(const std::string& file, const std::string& pointer) const {
  const OptionCheck check{file, pointer};
  check(steps >= 1 && steps <= kMaxSteps, "steps", "expected 1 to " + std::to_string(kMaxSteps) + " steps");
  check(rescale_t > 0.0, "rescale_t", "must be positive");
  check(sigma_min >= 0.0 && sigma_min < 1.0, "sigma_min", "must lie in [0, 1)");
  check(cfg_every >= 1 && cfg_every <= kMaxSteps, "cfg_every", "expected 1 to " + std::to_string(kMaxSteps) + " steps");
  check(velocity_tolerance >= 0.0 && velocity_tolerance <= 1.0, "velocity_tolerance", "must lie in [0, 1]");
  check(windowed_steps >= 0 && windowed_steps <= kMaxSteps, "windowed_steps",
        "expected 0 to " + std::to_string(kMaxSteps) + " steps");
  check(window >= 1 && window <= kMostWindow, "window", "expected 1 to " + std::to_string(kMostWindow) + " places");
  check(!cfg_interval || cfg_interval->first <= cfg_interval->second, "cfg_interval", "the lower end comes first");
}

std::vector<double> time_grid(const SamplerOptions& options) {
  std::vector<double> times;
  const double r = options.rescale_t, spacing = -1.0 / static_cast<double>(options.steps);
  for (std::int64_t i = 0; i <= options.steps; ++i) {
    // The published grid to the last bit, which decides whether the end of an interval is inside.
    const double t = i == options.steps ? 0.0 : static_cast<double>(i) * spacing + 1.0;
    times.push_back(r * t / (1.0 + (r - 1.0) * t));
  }
  return times;
}

Sampled sample_flow(const Streams& noise, const Velocities& velocities, const SamplerOptions& options,
                    const SamplingExtras& extras) {
  options.validate();
  if (extras.inpainting != nullptr) {
    check_streams(extras.inpainting->x_0, noise, "the known latent");
    check_streams(extras.inpainting->noise, noise, "the known noise");
    TORCH_CHECK(extras.inpainting->mask.size() == noise.size(), "one inpainting mask per stream");
  }
  const torch::NoGradGuard no_grad;
  const nn::ConditionCache keep(velocities.conditions);
  const std::vector<double> times = time_grid(options);
  Sampled result;
  Streams x = noise;
  GuidedVelocity guided(velocities, options);
  EarlierStep before;
  bool was_guided = false;
  for (std::size_t step = 0; step + 1 < times.size(); ++step) {
    const double t = times[step], next = times[step + 1];
    const auto number = static_cast<std::int64_t>(step);
    const nn::AttentionWindows windows(number < options.windowed_steps ? options.window : 0);
    const bool is_guided = velocities.unconditional && guided_at(options, t);
    if (number > 0 && (number == options.windowed_steps || is_guided != was_guided)) {
      guided.forget();
      before = {};  // a line through both velocities would point past the change
    }
    was_guided = is_guided;
    if (velocities.step_begins) velocities.step_begins(number);
    const Streams velocity = guided.of_step(x, t, /*last=*/step + 2 == times.size());
    if (extras.trajectory) {
      Streams x_0;
      for (std::size_t i = 0; i < x.size(); ++i)
        x_0.push_back(x0_from_velocity(x[i], velocity[i], t, options.sigma_min));
      result.x_0.push_back(x_0);
    }
    x = step_from(x, velocity, t, next, before, guided, options);
    before = {velocity, t - next};
    if (extras.inpainting != nullptr) keep_known(x, next, *extras.inpainting, options.sigma_min);
    if (extras.trajectory) result.x_t.push_back(x);
    if (extras.progress) extras.progress(number + 1, options.steps);
  }
  result.samples = x;
  result.passes = guided.passes();
  return result;
}

void FlowStageOptions::flow_fields(ConfigFields& f, double cfg_strength) {
  f("p_uncond", p_uncond, {0.0, 1.0});
  f.object("t_schedule", t_schedule);
  f("sigma_min", sigma_min, {0.0, 0.5});
  bool train_inpaint = false;
  f("train_inpaint", train_inpaint);
  if (train_inpaint) throw f.not_supported("train_inpaint", "train_inpaint, whose model is not published");
  f.unused("p_x0_inject");  // only means something with train_inpaint

  sampler.steps = 25;
  sampler.cfg_strength = cfg_strength;
  f.object("sampler", [this](ConfigFields& keys) {
    if (keys.reads() && keys.reader().has("sigma_min"))
      throw keys.error("sigma_min", "samples take the trainer's sigma_min; leave this one out");
    sampler.fields(keys);
    if (keys.reads()) sampler.validate(keys.reader().file(), keys.reader().pointer_to(""));
  });
  sampler.sigma_min = sigma_min;
  f("sample_assets", sample_assets, {1, 64});
  f("eval_max_assets", eval_max_assets, {0});
  f("eval_times", eval_times, {1, 1000});
  f("eval_on_schedule", eval_on_schedule);
}

torch::Tensor FlowStageOptions::eval_grid() const {
  const torch::Tensor even = (torch::arange(eval_times).to(torch::kFloat32) + 0.5) / static_cast<double>(eval_times);
  return eval_on_schedule ? t_schedule.quantiles(even) : even;
}

}  // namespace anigen::flow
