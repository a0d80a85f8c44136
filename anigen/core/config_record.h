#pragma once
#include <string>

#include "anigen/core/config.h"

namespace anigen {

/// Record of what readers of configs ask for on this thread while it lives: the keys with their types, bounds, words
/// and defaults, as a JSON Schema of the file, and a config written out in full.
class ConfigRecord {
 public:
  ConfigRecord();
  ~ConfigRecord();
  ConfigRecord(const ConfigRecord&) = delete;
  ConfigRecord& operator=(const ConfigRecord&) = delete;

  /// JSON Schema of the file's top level. A key that is read in a form of its own may be anything.
  const Json& schema() const { return schema_; }
  /// The config with the defaults of all keys that were read and that it leaves out.
  Json completed(const Json& config) const;

  /// Schema of the value at a pointer, made where there is none yet: for ConfigReader.
  Json& node(const std::string& pointer);
  /// The innermost record of this thread; nullptr without one.
  static ConfigRecord* current();

 private:
  Json schema_ = {{"type", "object"}};
  ConfigRecord* before_;
};

}  // namespace anigen
