#include "anigen/io/rigs/anymate_archive.h"

#include <algorithm>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/arrays/torch_storages.h"
#include "anigen/io/arrays/torch_tree.h"
#include "anigen/io/arrays/zip_archive.h"

namespace anigen::io {

namespace pickle = pickle;

namespace {

constexpr std::string_view kPickleName = "data.pkl";

const pickle::Value* item(const pickle::Value& dict, std::string_view key) {
  for (std::size_t i = 0; i + 1 < dict.items.size(); i += 2) {
    if (dict.items[i]->kind == pickle::Kind::kString && dict.items[i]->text == key) return dict.items[i + 1];
  }
  return nullptr;
}

bool is_dict(const pickle::Value* value) { return value->kind == pickle::Kind::kDict; }

bool is_list(const pickle::Value& value) {
  return value.kind == pickle::Kind::kList || value.kind == pickle::Kind::kTuple ||
         value.kind == pickle::Kind::kObjectArray;
}

const ZipMember& pickle_member(const ZipReader& archive) {
  for (const ZipMember& member : archive.members()) {
    const std::size_t slash = member.name.find('/');
    if (slash != std::string::npos && member.name.substr(slash + 1) == kPickleName) return member;
  }
  throw InputError(archive.file(), "", "a zip archive without <name>/data.pkl: not written by torch.save, or damaged");
}

}  // namespace

struct AnymateArchive::Content {
  explicit Content(const std::filesystem::path& file) : archive(file) {
    const ZipMember& member = pickle_member(archive);
    member_name = member.name;
    folder = member.name.substr(0, member.name.size() - kPickleName.size());
    const ZipMember* order = archive.find(folder + "byteorder");
    constexpr std::uint64_t kLongest = 16;
    big_endian = order != nullptr && order->bytes <= kLongest && archive.read(*order) == "big";
    document = pickle::load(archive.read(member), {archive.file(), member.name, 0, true});
  }

  ZipReader archive;
  std::string member_name, folder;
  bool big_endian = false;
  pickle::Document document;
  std::vector<const pickle::Value*> samples;
};

AnymateArchive::AnymateArchive(const std::filesystem::path& file) : content_(std::make_unique<Content>(file)) {
  const pickle::Value& root = content_->document.root();
  std::vector<std::string> keys;
  if (is_list(root)) {
    for (const pickle::Value* value : root.items) content_->samples.push_back(value);
  } else if (is_dict(&root) && (item(root, "joints") != nullptr || item(root, "bones") != nullptr)) {
    content_->samples.push_back(&root);
  } else if (is_dict(&root)) {
    for (std::size_t i = 0; i + 1 < root.items.size(); i += 2) {
      keys.emplace_back(root.items[i]->text);
      content_->samples.push_back(root.items[i + 1]);
    }
  }
  const std::string stem = file.stem().string();
  const bool dicts = std::all_of(content_->samples.begin(), content_->samples.end(), is_dict);
  if (content_->samples.empty() || !dicts)
    throw InputError(file.string(), content_->member_name, "is no list of sample dictionaries");
  for (std::size_t i = 0; i < content_->samples.size(); ++i) {
    const pickle::Value* name = item(*content_->samples[i], "name");
    if (name != nullptr && name->kind == pickle::Kind::kString && !name->text.empty())
      names_.emplace_back(name->text);
    else if (!keys.empty() && !keys[i].empty())
      names_.push_back(keys[i]);
    else
      names_.push_back(content_->samples.size() == 1 ? stem : stem + "#" + std::to_string(i));
  }
}

AnymateArchive::~AnymateArchive() = default;
AnymateArchive::AnymateArchive(AnymateArchive&&) noexcept = default;

NamedArrays AnymateArchive::sample(std::size_t index) const {
  const NpyPlace place{content_->archive.file(), content_->member_name};
  const std::vector<TorchLeaf> leaves = torch_leaves(*content_->samples.at(index), place);
  return TorchStorages(content_->archive, content_->folder, content_->big_endian).materialize(leaves);
}

}  // namespace anigen::io
