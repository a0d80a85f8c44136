#include "anigen/models/rignet/options.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/config_reader.h"

namespace anigen::models::rignet {
namespace {

constexpr std::int64_t kLeastWidth = 8;

}  // namespace

const std::vector<std::string>& task_names() {
  static const std::vector<std::string> names = {"joints", "connectivity", "skin"};
  return names;
}

const std::string& name_of(Task task) { return task_names()[static_cast<std::size_t>(task)]; }

std::int64_t RignetOptions::wide(std::int64_t published) const {
  const auto half = static_cast<std::int64_t>(std::llround(0.5 * width * static_cast<double>(published)));
  return std::max(kLeastWidth, 2 * half);
}

RignetOptions RignetOptions::from_json(const Json& json, const std::string& file, const std::string& pointer) {
  ConfigReader reader(json, file, pointer);
  RignetOptions options;
  const std::string task = reader.choice("task", name_of(options.task), task_names());
  const auto found = std::find(task_names().begin(), task_names().end(), task);
  options.task = static_cast<Task>(found - task_names().begin());
  options.width = reader.number("width", options.width, 1e-3, 16.0);
  options.dropout = reader.number("dropout", options.dropout, 0.0, 0.99);
  options.bandwidth = reader.number("bandwidth", options.bandwidth, 1e-4, 1.0);
  options.bones = reader.integer("bones", options.bones, 1, 64);
  options.mirrored = reader.boolean("mirrored", options.mirrored);
  options.least_weight = reader.number("least_weight", options.least_weight, 0.0, 1.0);
  reader.finish();
  return options;
}

}  // namespace anigen::models::rignet
