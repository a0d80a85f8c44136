#pragma once
#include <functional>

#include "anigen/core/text.h"
#include "anigen/flow/sampler.h"

namespace anigen::flow {

/// Rule by which several images of one object steer a flow that was trained on one image, as in the image pipeline of
/// TRELLIS (Xiang et al. 2025), which names them multidiffusion and stochastic. Guidance stays: its negative is that of
/// no image, once a step.
enum class ViewRule {
  kAverage,    ///< every step goes along the mean of the velocities under each view: a pass for each view
  kStochastic  ///< each step sees one view, in turn: one pass, so that steps must be at least as many as views
};

inline const Words<ViewRule> kViewRuleWords = {{ViewRule::kAverage, "average"}, {ViewRule::kStochastic, "stochastic"}};
/// @throws InputError for another word
ViewRule parse_view_rule(const std::string& word);

/// Velocities for sample_flow() under several views of one object. One view gives make(views) itself.
/// @param views [V, M, C], the tokens of each view @param make velocities under one condition [1, M, C]
/// @param options of the sampler, whose steps decide whether every view has its turn
/// @throws InputError without a view, and for kStochastic with fewer steps than views
Velocities under_views(const Tensor& views, ViewRule rule, const SamplerOptions& options,
                       const std::function<Velocities(const Tensor& condition)>& make);

}  // namespace anigen::flow
