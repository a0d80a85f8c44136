#pragma once
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "anigen/studio/job_store.h"

namespace anigen::studio {

/// Course of a job over time.
struct Timeline {
  std::vector<std::pair<std::string, double>> stages;  ///< each with its begin, in seconds
  double seconds = 0.0;                                ///< until the end
};

/// Course of the latest job that ended well and did what this one does: of its kind and method, with the same end.
std::optional<Timeline> timeline_alike(const std::vector<JobRecord>& jobs, const JobRecord& job);

/// Seconds that a job still takes, when its present stage and those behind it take as long as in `alike`.
/// @param stages that the job went through; the last is the present one @param fraction done of it; 0: not known
/// @param now seconds since its begin @return nothing when `alike` has no such stage
std::optional<double> seconds_left(const Timeline& alike, const std::vector<std::pair<std::string, double>>& stages,
                                   double fraction, double now);

}  // namespace anigen::studio
