#include <mutex>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/rigs/anymate_archive.h"
#include "anigen/io/rigs/anymate_sample.h"
#include "anigen/io/rigs/content_id.h"
#include "anigen/io/rigs/file_list.h"

namespace anigen::io {

struct AnymateSource::Shard {
  explicit Shard(const std::filesystem::path& path) : file(path.string()), archive(path) {}
  std::string file;
  AnymateArchive archive;
  mutable std::mutex reading;  ///< zip archives have one position
};

AnymateSource::AnymateSource(const std::vector<std::filesystem::path>& files, const SourceOptions& options, bool single)
    : options_(options), single_(single) {
  for (const std::filesystem::path& file : files) {
    require_content(file);
    shards_.push_back(std::make_unique<Shard>(file));
    const std::vector<std::string>& names = shards_.back()->archive.names();
    for (std::size_t i = 0; i < names.size(); ++i) {
      const auto [there, is_new] = places_.try_emplace(names[i], Place{shards_.size() - 1, i});
      if (!is_new) {
        throw InputError(file.string(), "sample " + std::to_string(i),
                         "the name " + names[i] + " is also that of sample " + std::to_string(there->second.index) +
                             " in " + shards_[there->second.shard]->file);
      }
      ids_.push_back(names[i]);
    }
  }
}

AnymateSource::~AnymateSource() = default;

NamedArrays AnymateSource::arrays(const std::string& id, const Shard*& shard) const {
  const auto found = places_.find(id);
  if (found == places_.end()) throw InputError(describe(), "", "has no sample \"" + id + "\"");
  shard = shards_[found->second.shard].get();
  const std::lock_guard<std::mutex> lock(shard->reading);
  return shard->archive.sample(found->second.index);
}

std::string AnymateSource::sample_id(const std::string& id) const {
  const Shard* shard = nullptr;
  return content_id(arrays(id, shard));
}

RiggedShape AnymateSource::read(const std::string& id) const {
  const Shard* shard = nullptr;
  const NamedArrays sample = arrays(id, shard);
  try {
    RiggedShape shape = shape_from_anymate(sample, id, shard->file);
    turn_to_z_up(shape, options_.axes, Axes::kYUp);
    return shape;
  } catch (const InputError& error) {
    throw InputError(shard->file, "sample " + id + (error.place().empty() ? "" : ", " + error.place()),
                     error.problem());
  }
}

std::vector<std::filesystem::path> AnymateSource::files(const std::string& id) const {
  const auto found = places_.find(id);
  if (found == places_.end()) throw InputError(describe(), "", "has no sample \"" + id + "\"");
  return {shards_[found->second.shard]->file};
}

std::string AnymateSource::describe() const {
  std::string files = shards_.size() == 1 ? shards_.front()->file : std::to_string(shards_.size()) + " files";
  return "Anymate, " + files + ": " + std::to_string(ids_.size()) + " samples";
}

}  // namespace anigen::io
