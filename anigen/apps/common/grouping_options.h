#pragma once
#include "anigen/apps/common/command_line.h"
#include "anigen/skeleton_field/voting.h"

namespace anigen {

/// The options of every program that groups votes for joints.
inline void add_grouping_options(CLI::App& app, skeleton_field::MeanShiftOptions& grouping) {
  app.add_option("--grouping-bandwidth", grouping.bandwidth,
                 "Votes for joints so far apart become one, in units of the box; more for models that trained briefly")
      ->check(number(0, 1, RangeEnds::kOpenBelow))
      ->capture_default_str();
  app.add_option("--grouping-least-votes", grouping.min_cluster_size,
                 "Groups of fewer votes are no joint, unless none would be left; fewer for coarse voxels")
      ->check(whole_number(1, 1'000'000))
      ->capture_default_str();
}

}  // namespace anigen
