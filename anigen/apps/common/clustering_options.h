#pragma once
#include "anigen/apps/common/command_line.h"
#include "anigen/skeleton_field/voting.h"

namespace anigen {

/// The options of every program that clusters votes for joints.
inline void add_clustering_options(CLI::App& app, skeleton_field::MeanShiftOptions& clustering) {
  add_option(app, "--cluster-bandwidth", clustering.bandwidth)->check(number(0, 1, RangeEnds::kOpenBelow));
  add_option(app, "--cluster-min-votes", clustering.min_cluster_size)->check(whole_number(1, 1'000'000));
}

}  // namespace anigen
