#pragma once
#include <string>
#include <vector>

namespace anigen::eval {

enum class Better { kLower, kHigher, kNeither };

/// What a key of metrics.json means. The definitions in full: docs/metrics.md.
struct MetricInfo {
  std::string key;
  std::string label;  ///< column head for people
  Better better = Better::kLower;
  std::string unit;       ///< "box": longest side of the ground truth's bounding box is 1; "1": a plain number
  std::string group;      ///< skeleton, transport, skin, motion, surface, image, anymate, run
  bool headline = false;  ///< shown in the short table
};

/// Every metric, in the order of tables and files.
const std::vector<MetricInfo>& metric_table();

/// nullptr for an unknown key.
const MetricInfo* find_metric(const std::string& key);

/// "↓", "↑", or nothing.
std::string arrow(Better better);

}  // namespace anigen::eval
