#pragma once
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>
#include <unordered_map>
#include <vector>

#include "anigen/core/random.h"
#include "anigen/data/view_files.h"

namespace anigen::data {

/// Values that were read from files, kept up to a limit of memory. What comes when it is full is read anew each time:
/// epochs visit everything equally often, so that nothing is worth more than what is there. Thread-safe.
template <typename Value>
class ReadCache {
 public:
  explicit ReadCache(std::uintmax_t bytes) : free_(bytes) {}

  /// @param read () → Value, called without a lock, perhaps by several threads @param bytes_of Value → its memory
  template <typename Read, typename BytesOf>
  std::shared_ptr<const Value> get(const std::string& key, const Read& read, const BytesOf& bytes_of) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      const auto found = values_.find(key);
      if (found != values_.end()) return found->second;
    }
    auto value = std::make_shared<const Value>(read());
    const std::uintmax_t bytes = bytes_of(*value);
    const std::lock_guard<std::mutex> lock(mutex_);
    if (bytes > free_) return value;
    const auto [place, added] = values_.emplace(key, value);
    if (added) free_ -= bytes;
    return place->second;
  }

 private:
  std::mutex mutex_;
  std::uintmax_t free_;
  std::unordered_map<std::string, std::shared_ptr<const Value>> values_;
};

/// Condition pictures, each decoded, cropped and resized once while there is memory.
class PictureCache {
 public:
  /// @param bytes 0: everything is read anew
  explicit PictureCache(std::uintmax_t bytes) : frames_(bytes), pictures_(bytes) {}

  /// As read_condition_image(): the same picture, bit for bit, from the same draw.
  std::vector<float> read(const std::filesystem::path& folder, int size, Rng& rng, ConditionPictures kind);
  /// One view of the folder. @param view counts condition_views() @throws InputError also when there is no such view
  std::vector<float> read(const std::filesystem::path& folder, int size, std::size_t view, ConditionPictures kind);

 private:
  std::shared_ptr<const std::vector<std::string>> views(const std::filesystem::path& folder);

  ReadCache<std::vector<std::string>> frames_;  // names of the pictures of a folder
  ReadCache<io::Image> pictures_;
};

}  // namespace anigen::data
