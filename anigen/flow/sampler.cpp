#include "anigen/flow/sampler.h"

#include <algorithm>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/nn/condition_cache.h"

namespace anigen::flow {

namespace {

constexpr std::int64_t kMaxSteps = 100000;

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

Streams velocity_at(const Streams& x, double t, const Velocities& velocities, const SamplerOptions& options) {
  const auto time = static_cast<float>(kTimeScale * t);
  Streams velocity = velocities.conditional(x, time);
  check_streams(velocity, x, "the velocity");
  if (!velocities.unconditional || !guided_at(options, t)) return velocity;
  const Streams negative = velocities.unconditional(x, time);
  check_streams(negative, x, "the unconditional velocity");
  for (std::size_t i = 0; i < x.size(); ++i) {  // v ← (1 + s) v − s v_neg
    velocity[i] = (1.0 + options.cfg_strength) * velocity[i] - options.cfg_strength * negative[i];
  }
  return velocity;
}

// x − Δt v
Streams moved(const Streams& x, const Streams& velocity, double span) {
  Streams result;
  for (std::size_t i = 0; i < x.size(); ++i) result.push_back(x[i] - span * velocity[i]);
  return result;
}

/// Result of one step. @param first the velocity at x and t
Streams step_from(const Streams& x, const Streams& first, double t, double next, const Velocities& velocities,
                  const SamplerOptions& options) {
  const double span = t - next;               // Δt = t − t'
  if (options.solver == Solver::kMidpoint) {  // x − Δt v(x − ½ Δt v, t − ½ Δt)
    return moved(x, velocity_at(moved(x, first, 0.5 * span), t - 0.5 * span, velocities, options), span);
  }
  const Streams end = moved(x, first, span);  // Euler: x_t' = x_t − Δt v(x_t, t)
  if (options.solver == Solver::kEuler || next <= 0.0) return end;
  const Streams second = velocity_at(end, next, velocities, options);
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
                                                                     {"heun", Solver::kHeun}};
  return kNames;
}

}  // namespace

const std::string& word_of(Solver solver) { return solver_names()[static_cast<std::size_t>(solver)].first; }

Solver parse_solver(const std::string& word) {
  for (const auto& [name, solver] : solver_names()) {
    if (word == name) return solver;
  }
  throw InputError("", "solver", "expected euler, midpoint or heun, found '" + word + "'");
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
}

void SamplerOptions::validate(const std::string& file, const std::string& pointer) const {
  const OptionCheck check{file, pointer};
  check(steps >= 1 && steps <= kMaxSteps, "steps", "expected 1 to " + std::to_string(kMaxSteps) + " steps");
  check(rescale_t > 0.0, "rescale_t", "must be positive");
  check(sigma_min >= 0.0 && sigma_min < 1.0, "sigma_min", "must lie in [0, 1)");
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
  for (std::size_t step = 0; step + 1 < times.size(); ++step) {
    const double t = times[step], next = times[step + 1];
    if (velocities.step_begins) velocities.step_begins(static_cast<std::int64_t>(step));
    const Streams velocity = velocity_at(x, t, velocities, options);
    if (extras.trajectory) {
      Streams x_0;
      for (std::size_t i = 0; i < x.size(); ++i)
        x_0.push_back(x0_from_velocity(x[i], velocity[i], t, options.sigma_min));
      result.x_0.push_back(x_0);
    }
    x = step_from(x, velocity, t, next, velocities, options);
    if (extras.inpainting != nullptr) keep_known(x, next, *extras.inpainting, options.sigma_min);
    if (extras.trajectory) result.x_t.push_back(x);
    if (extras.progress) extras.progress(static_cast<std::int64_t>(step) + 1, options.steps);
  }
  result.samples = x;
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
}

std::size_t FlowStageOptions::eval_count(std::size_t held_out) const {
  const auto most = static_cast<std::size_t>(eval_max_assets);
  return most == 0 ? held_out : std::min(most, held_out);
}

torch::Tensor FlowStageOptions::eval_grid() const {
  return (torch::arange(eval_times).to(torch::kFloat32) + 0.5) / static_cast<double>(eval_times);
}

}  // namespace anigen::flow
