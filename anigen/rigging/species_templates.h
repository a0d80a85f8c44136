#pragma once
#include <string>
#include <vector>

#include "anigen/rigging/pinocchio_template.h"

namespace anigen::rigging {

/// Hips, spine, chest, neck, head, and on either side upper arm, lower arm, hand, upper leg, lower leg, foot and toes:
/// 19 joints, and tips of head, hands and toes as guides. Arms hang at 35° below the horizontal, half way between the
/// poses that people model in.
TemplateSkeleton biped_template();

/// Hips, spine, chest, neck, head, three joints of the tail, and four legs of four joints each: 24 joints, and tips of
/// nose, tail and feet as guides.
TemplateSkeleton quadruped_template();

/// Words of all templates: biped, quadruped, horse (long neck, legs under the body), fox (low, long tail), bird (wings
/// spread), dragon (wings and four legs), kaiju (upright on a heavy tail), fish (side fins), snake, spider (eight
/// legs). Proportions from horse on were measured on public skeletons (docs/rigging.md).
std::vector<std::string> template_words();

/// Words of those that are tried when a user names none. The price of an embedding says how far a template must bend,
/// not how much of the mesh it leaves without bones, so that few-limbed templates would win everywhere.
std::vector<std::string> usual_template_words();

/// @throws InputError listing all words for another one
TemplateSkeleton species_template(const std::string& word);

}  // namespace anigen::rigging
