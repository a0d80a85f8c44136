#pragma once
#include "anigen/eval/skin_evaluation.h"
#include "anigen/eval/tables.h"

namespace anigen::eval {

/// Methods × scores over a group of assets: mean l1, l2, KL, median l1, and mean l1 by number of true influences.
Table summary_table(const SkinEvaluation& evaluation, Group group);

/// The first method's scores per asset of a group, worst l1 first; failures last with their reason.
Table asset_table(const SkinEvaluation& evaluation, Group group);

/// Assets of a group, whether they have scores or not.
std::size_t count(const SkinEvaluation& evaluation, Group group);

}  // namespace anigen::eval
