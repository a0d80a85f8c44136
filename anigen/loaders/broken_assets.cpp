#include "anigen/loaders/broken_assets.h"

#include <algorithm>

#include "anigen/core/error.h"
#include "anigen/core/log.h"

namespace anigen::loaders {

void report_broken(const std::vector<std::string>& problems, std::size_t assets, bool skip_broken) {
  constexpr std::size_t kNamed = 5;
  if (!problems.empty() && !skip_broken) {
    std::string named;
    for (std::size_t i = 0; i < std::min(kNamed, problems.size()); ++i) named += "\n  " + problems[i];
    throw InputError("", "dataset",
                     std::to_string(problems.size()) + " of " + std::to_string(assets) +
                         " assets cannot be read; \"skip_broken\": true leaves them out:" + named);
  }
  for (const std::string& problem : problems) log::warn("left out: {}", problem);
  if (problems.size() >= assets) {
    throw InputError("", "dataset", "none of the " + std::to_string(assets) + " assets can be read");
  }
}

void BrokenAssets::note(const std::string& id, const std::string& problem) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!problems_.emplace(id, problem).second) return;
  log::warn("{} broken assets so far; another one takes the place of {}: {}", problems_.size(), id, problem);
}

std::size_t BrokenAssets::count() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return problems_.size();
}

std::map<std::string, std::string> BrokenAssets::problems() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return problems_;
}

}  // namespace anigen::loaders
