#pragma once
/// Says whether a rig is good: weights, joints, names, axes, and what poses do to the surface. lint_rig() runs all
/// checks; each family has a header: weight_checks.h, joint_checks.h, name_checks.h, pose_checks.h. docs/lint.md
/// explains every code.
#include <cstdint>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/lint/finding.h"

namespace anigen::lint {

struct LintOptions {
  /// Repairs of the importer: defects of the file that the asset no longer shows. Empty for assets made in memory.
  std::vector<io::ImportNote> notes;
  bool poses = true;       ///< false: no stretched and inverted faces, no self-intersections
  std::uint64_t seed = 0;  ///< of the choice of joints where a rig has too many to pose them all
};

/// Checks a rig in its bind pose and in poses of its own. The asset may be anything: broken arrays and numbers that
/// are not finite become findings ("broken-asset", "bad-weights"), and the checks that cannot run are left out. Any
/// frame with Z up and any unit. Runs on all threads; the result does not depend on them. A rig of 20,000 vertices and
/// 50 joints takes about a second on two cores, more joints no longer: poses are limited by work.
RigLint lint_rig(const Asset& asset, const LintOptions& options = {});

}  // namespace anigen::lint
