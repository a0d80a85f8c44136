#include "anigen/flow/several_views.h"

#include <memory>
#include <utility>

#include "anigen/core/error.h"

namespace anigen::flow {

namespace {

// The mean of several velocities, summed in the order of the views.
VelocityFunction mean_of(std::vector<VelocityFunction> views) {
  return [views = std::move(views)](const Streams& x, float time) {
    Streams mean = views.front()(x, time);
    for (std::size_t view = 1; view < views.size(); ++view) {
      const Streams velocity = views[view](x, time);
      TORCH_CHECK(velocity.size() == mean.size(), "velocities of views differ in their streams");
      for (std::size_t i = 0; i < mean.size(); ++i) mean[i] = mean[i] + velocity[i];
    }
    for (Tensor& stream : mean) stream = stream / static_cast<double>(views.size());
    return mean;
  };
}

}  // namespace

ViewRule parse_view_rule(const std::string& word) { return value_of(kViewRuleWords, word, "views"); }

Velocities under_views(const Tensor& views, ViewRule rule, const SamplerOptions& options,
                       const std::function<Velocities(const Tensor& condition)>& make) {
  const std::int64_t count = views.dim() == 3 ? views.size(0) : 0;
  if (count == 0) throw InputError("", "views", "no image of the object");
  if (count == 1) return make(views);
  if (rule == ViewRule::kStochastic && options.steps < count) {
    throw InputError("", "views",
                     "the rule 'stochastic' shows one view a step, and " + std::to_string(options.steps) +
                         (options.steps == 1 ? " step leaves" : " steps leave") + " views of " + std::to_string(count) +
                         " out: take more steps, or 'average'");
  }
  Velocities shared;
  std::vector<VelocityFunction> conditional;
  for (std::int64_t view = 0; view < count; ++view) {
    Velocities one = make(views.narrow(0, view, 1));
    conditional.push_back(std::move(one.conditional));
    if (view == 0) shared.unconditional = std::move(one.unconditional);
  }
  shared.conditions = static_cast<std::size_t>(count) + 1;
  if (rule == ViewRule::kAverage) {
    shared.conditional = mean_of(std::move(conditional));
    return shared;
  }
  const auto turn = std::make_shared<std::size_t>(0);
  shared.step_begins = [turn, count](std::int64_t step) { *turn = static_cast<std::size_t>(step % count); };
  shared.conditional = [turn, conditional = std::move(conditional)](const Streams& x, float time) {
    return conditional[*turn](x, time);
  };
  return shared;
}

}  // namespace anigen::flow
