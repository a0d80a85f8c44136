#pragma once
#include <filesystem>
#include <map>
#include <string>

#include "anigen/experiment/plan.h"

namespace anigen::experiment {

/// What jobs take here, by step: the author's minutes times how far they were off for earlier jobs of that step;
/// without such minutes the mean of the earlier jobs. Where a step was never run, the author's word counts.
class Estimates {
 public:
  explicit Estimates(const std::filesystem::path& out);

  double seconds(const Job& job) const;  ///< 0: unknown
  double bytes(const Job& job) const;    ///< of disk; 0: unknown

 private:
  struct Sum {
    double seconds = 0, bytes = 0;
    double stated = 0, expected = 0;  ///< seconds of jobs whose author stated them, and what was stated
    int jobs = 0;
  };
  std::map<std::string, Sum> by_step_;
};

/// "3 h 05 min", "12 min", "40 s"; "?" for 0.
std::string duration_text(double seconds);

/// "1.2 GB", "35 MB"; "?" for 0.
std::string size_text(double bytes);

}  // namespace anigen::experiment
