#include <cstdio>

#include "anigen/prepare/dataset.h"

namespace anigen::prepare {
namespace {

constexpr std::size_t kMostShown = 20;

std::string mebibytes(std::uintmax_t bytes) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f MiB", static_cast<double>(bytes) / 1048576.0);
  return text;
}

}  // namespace

Json to_json(const PrepareSummary& summary) {
  Json rejected = Json::array();
  for (const Rejected& one : summary.rejected) {
    rejected.push_back(
        {{"file_identifier", one.file_identifier}, {"reason", one.reason}, {"step", one.step}, {"rule", one.rule}});
  }
  return {{"prepared", summary.prepared()},
          {"real", summary.real},
          {"procedural", summary.procedural},
          {"reused", summary.reused},
          {"variants", summary.variants},
          {"rejected_poses", summary.rejected_poses},
          {"bad_skeleton", summary.bad_skeleton},
          {"bad_skin", summary.bad_skin},
          {"train", summary.train},
          {"test", summary.test},
          {"failed_steps", summary.failed_steps},
          {"bytes", summary.bytes},
          {"merged", summary.merged},
          {"rejected", rejected},
          {"steps", to_json(summary.costs)}};
}

std::string to_text(const PrepareSummary& summary) {
  const auto n = [](std::size_t count) { return std::to_string(count); };
  std::string text = "prepared " + n(summary.prepared()) + " assets (" + n(summary.real) + " real, " +
                     n(summary.procedural) + " procedural; " + n(summary.reused) + " were there already)\n";
  if (summary.variants + summary.rejected_poses > 0) {
    text += "and " + n(summary.variants) + " posed variants of them (" + n(summary.rejected_poses) +
            " more had no usable pose)\n";
  }
  if (summary.merged) {
    text += "train " + n(summary.train) + ", test " + n(summary.test) + ", not usable " + n(summary.bad_skeleton) +
            ", bad skin " + n(summary.bad_skin) + "; " + mebibytes(summary.bytes) + "\n";
  } else {
    text += "one shard of several: `anigen-prepare merge` makes the tables when all have finished\n";
  }
  if (!summary.rejected.empty()) text += "rejected " + n(summary.rejected.size()) + ", see rejected.csv:\n";
  for (std::size_t i = 0; i < summary.rejected.size() && i < kMostShown; ++i) {
    text += "  " + summary.rejected[i].file_identifier + ": " + summary.rejected[i].reason + "\n";
  }
  if (summary.rejected.size() > kMostShown) text += "  …\n";
  if (summary.failed_steps > 0) text += n(summary.failed_steps) + " steps failed, see failures.jsonl\n";
  return text + to_text(summary.costs);
}

}  // namespace anigen::prepare
