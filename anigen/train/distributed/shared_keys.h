#pragma once
#include <cstdint>
#include <optional>
#include <string>

namespace anigen::train {

/// Small values that all ranks see, beside the connections between them. Functions may be called from several threads
/// and throw when whoever keeps the values is gone.
class SharedKeys {
 public:
  virtual ~SharedKeys() = default;
  virtual void set(const std::string& key, const std::string& value) = 0;
  virtual std::optional<std::string> find(const std::string& key) = 0;
  /// Adds to a number that begins at 0. @return the sum
  virtual std::int64_t add(const std::string& key, std::int64_t amount) = 0;
};

}  // namespace anigen::train
