#pragma once
#include <cstddef>
#include <map>
#include <mutex>
#include <string>
#include <vector>

namespace anigen::loaders {

/// What to do about assets that turned out unreadable before training begins: an error that counts them and names the
/// first, or with skip_broken a warning for each. @throws InputError also when none of `assets` is left
void report_broken(const std::vector<std::string>& problems, std::size_t assets, bool skip_broken);

/// Assets that could not be read while training: each is named in the log once. Thread-safe.
class BrokenAssets {
 public:
  void note(const std::string& id, const std::string& problem);
  std::size_t count() const;
  std::map<std::string, std::string> problems() const;  ///< id → what is wrong with it

 private:
  mutable std::mutex mutex_;
  std::map<std::string, std::string> problems_;
};

}  // namespace anigen::loaders
