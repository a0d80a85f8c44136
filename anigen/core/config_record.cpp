#include "anigen/core/config_record.h"

#include <utility>
#include <vector>

namespace anigen {

namespace {

thread_local ConfigRecord* current_record = nullptr;

void complete(Json& config, const Json& schema) {
  if (!config.is_object() || !schema.contains("properties")) return;
  for (const auto& [key, property] : schema["properties"].items()) {
    if (!config.contains(key)) {
      if (property.contains("default")) config[key] = property["default"];
      if (!property.contains("properties")) continue;
      Json below = Json::object();
      complete(below, property);
      if (!below.empty()) config[key] = std::move(below);
    } else {
      complete(config[key], property);
    }
  }
}

}  // namespace

ConfigRecord* ConfigRecord::current() { return current_record; }

ConfigRecord::ConfigRecord() : before_(std::exchange(current_record, this)) {}

ConfigRecord::~ConfigRecord() { current_record = before_; }

Json& ConfigRecord::node(const std::string& pointer) {
  std::vector<std::string> parts;
  for (Json::json_pointer left(pointer); !left.empty(); left.pop_back()) parts.push_back(left.back());
  Json* node = &schema_;
  for (auto part = parts.rbegin(); part != parts.rend(); ++part) {
    const bool index = part->find_first_not_of("0123456789") == std::string::npos;
    node = index ? &(*node)["items"] : &(*node)["properties"][*part];
  }
  return *node;
}

Json ConfigRecord::completed(const Json& config) const {
  Json whole = config;
  complete(whole, schema_);
  return whole;
}

}  // namespace anigen
