#pragma once
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::io {

/// The two parts of FILE#SAMPLE, where such a file or folder exists; nothing where the whole is a file, or none exists.
std::optional<std::pair<std::filesystem::path, std::string>> sample_of(const std::filesystem::path& path);

/// The source's id that a text means: the id itself, or its number from 0 in the source's order.
/// @param file for messages @throws InputError when there is neither; it says how many samples there are
std::string sample_called(const ShapeSource& source, const std::string& text, const std::string& file);

/// Files with many samples that are named again and again, each opened once. A file that cannot be opened is refused
/// every time for the reason found first.
class OpenShards {
 public:
  explicit OpenShards(SourceOptions options) : options_(options) {}

  /// Several threads may call at once. @param sample an id, or a number from 0 @throws InputError
  RiggedShape read(const std::filesystem::path& file, const std::string& sample) const;

 private:
  struct Shard {
    std::once_flag once;
    std::shared_ptr<const ShapeSource> source;
    std::string file, place, problem;
  };

  SourceOptions options_;
  mutable std::mutex mutex_;
  mutable std::map<std::filesystem::path, std::shared_ptr<Shard>> shards_;
};

/// One sample of a source.
std::unique_ptr<ShapeSource> single_sample(std::unique_ptr<ShapeSource> source, const std::string& id);

/// Several sources as one, in order. @throws InputError when two have a shape of the same id
std::unique_ptr<ShapeSource> joined_sources(std::vector<std::unique_ptr<ShapeSource>> parts,
                                            const std::string& description);

}  // namespace anigen::io
