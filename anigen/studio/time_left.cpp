#include "anigen/studio/time_left.h"

#include <algorithm>

namespace anigen::studio {

std::optional<Timeline> timeline_alike(const std::vector<JobRecord>& jobs, const JobRecord& job) {
  const auto same = [&](const JobRecord& other, const char* key) {
    return other.options.value(key, "") == job.options.value(key, "");
  };
  for (auto other = jobs.rbegin(); other != jobs.rend(); ++other) {
    if (other->state != JobState::kDone || other->kind != job.kind || other->stages.empty()) continue;
    if (same(*other, "method") && same(*other, "stop_at"))
      return Timeline{other->stages, other->ended - other->started};
  }
  return std::nullopt;
}

std::optional<double> seconds_left(const Timeline& alike, const std::vector<std::pair<std::string, double>>& stages,
                                   double fraction, double now) {
  if (stages.empty()) return std::nullopt;
  const auto& [name, begin] = stages.back();
  // The last of this name: a stage that comes again is nearer to the end each time.
  const auto found = std::find_if(alike.stages.rbegin(), alike.stages.rend(),
                                  [&, &stage = name](const auto& other) { return other.first == stage; });
  if (found == alike.stages.rend()) return std::nullopt;
  const double end = found == alike.stages.rbegin() ? alike.seconds : std::prev(found)->second;
  const double length = std::max(0.0, end - found->second);
  const double rest = fraction > 0.0 ? length * (1.0 - fraction) : std::max(0.0, length - (now - begin));
  return rest + std::max(0.0, alike.seconds - end);
}

}  // namespace anigen::studio
