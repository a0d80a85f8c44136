#include "anigen/io/rigs/samples.h"

#include <algorithm>
#include <unordered_map>

#include "anigen/core/error.h"

namespace anigen::io {

namespace fs = std::filesystem;

std::optional<std::pair<fs::path, std::string>> sample_of(const fs::path& path) {
  const std::string text = path.string();
  std::error_code ignored;
  if (fs::exists(path, ignored)) return std::nullopt;
  // Ids may hold the sign, too.
  for (std::size_t sign = text.find('#'); sign != std::string::npos; sign = text.find('#', sign + 1)) {
    if (fs::exists(text.substr(0, sign), ignored))
      return std::pair{fs::path(text.substr(0, sign)), text.substr(sign + 1)};
  }
  return std::nullopt;
}

std::string sample_called(const ShapeSource& source, const std::string& text, const std::string& file) {
  const std::vector<std::string> ids = source.ids();
  if (std::find(ids.begin(), ids.end(), text) != ids.end()) return text;
  constexpr std::size_t kLongestNumber = 9;
  const bool number = !text.empty() && text.find_first_not_of("0123456789") == std::string::npos;
  if (number && text.size() <= kLongestNumber && std::stoul(text) < ids.size()) return ids[std::stoul(text)];
  throw InputError(file, "#" + text,
                   number ? "is the number of no sample: it holds " + std::to_string(ids.size()) + ", counted from 0"
                          : "there is no sample of this name among its " + std::to_string(ids.size()));
}

RiggedShape OpenShards::read(const fs::path& file, const std::string& sample) const {
  std::shared_ptr<Shard> shard;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    std::shared_ptr<Shard>& known = shards_[file];
    if (!known) known = std::make_shared<Shard>();
    shard = known;
  }
  std::call_once(shard->once, [&] {
    try {
      shard->source = open_source(file, options_);
    } catch (const InputError& error) {
      shard->file = error.file();
      shard->place = error.place();
      shard->problem = error.problem();
    }
  });
  if (!shard->source) throw InputError(shard->file, shard->place, shard->problem);
  return shard->source->read(sample_called(*shard->source, sample, file.string()));
}

namespace {

/// Passes every question on to the source that has the shape.
class ForwardingSource : public ShapeSource {
 public:
  RiggedShape read(const std::string& id) const override { return of(id).read(id); }
  std::vector<fs::path> files(const std::string& id) const override { return of(id).files(id); }
  std::vector<std::string> other_names(const std::string& id) const override { return of(id).other_names(id); }
  std::string sample_id(const std::string& id) const override { return of(id).sample_id(id); }
  bool is_usable(const std::string& id) const override { return of(id).is_usable(id); }
  std::string category(const std::string& id) const override { return of(id).category(id); }

 protected:
  virtual const ShapeSource& of(const std::string& id) const = 0;
};

class SingleSample : public ForwardingSource {
 public:
  SingleSample(std::unique_ptr<ShapeSource> source, std::string id) : source_(std::move(source)), id_(std::move(id)) {}

  std::vector<std::string> ids() const override { return {id_}; }
  std::string describe() const override { return "sample " + id_ + " of " + source_->describe(); }
  bool is_single_file() const override { return true; }

 protected:
  const ShapeSource& of(const std::string& id) const override {
    if (id != id_) throw InputError(describe(), "", "has no sample \"" + id + "\"");
    return *source_;
  }

 private:
  std::unique_ptr<ShapeSource> source_;
  std::string id_;
};

class JoinedSources : public ForwardingSource {
 public:
  JoinedSources(std::vector<std::unique_ptr<ShapeSource>> parts, std::string description)
      : parts_(std::move(parts)), description_(std::move(description)) {
    for (const std::unique_ptr<ShapeSource>& part : parts_) {
      for (const std::string& id : part->ids()) {
        const auto [there, is_new] = holders_.try_emplace(id, part.get());
        if (!is_new)
          throw InputError(description_, "",
                           "the id \"" + id + "\" is in " + there->second->describe() + " and in " + part->describe() +
                               "; keep one of them");
        ids_.push_back(id);
      }
    }
  }

  std::vector<std::string> ids() const override { return ids_; }
  std::string describe() const override { return description_; }

 protected:
  const ShapeSource& of(const std::string& id) const override {
    const auto found = holders_.find(id);
    if (found == holders_.end()) throw InputError(description_, "", "there is no \"" + id + "\"");
    return *found->second;
  }

 private:
  std::vector<std::unique_ptr<ShapeSource>> parts_;
  std::string description_;
  std::vector<std::string> ids_;
  std::unordered_map<std::string, const ShapeSource*> holders_;
};

}  // namespace

std::unique_ptr<ShapeSource> single_sample(std::unique_ptr<ShapeSource> source, const std::string& id) {
  return std::make_unique<SingleSample>(std::move(source), id);
}

std::unique_ptr<ShapeSource> joined_sources(std::vector<std::unique_ptr<ShapeSource>> parts,
                                            const std::string& description) {
  return std::make_unique<JoinedSources>(std::move(parts), description);
}

}  // namespace anigen::io
