#include "anigen/io/torch_archive.h"

#include <algorithm>
#include <fstream>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/arrays/pickle_json.h"
#include "anigen/io/arrays/torch_storages.h"
#include "anigen/io/arrays/torch_tree.h"
#include "anigen/io/arrays/zip_archive.h"
#include "anigen/io/safetensors.h"

namespace anigen::io {
namespace {

constexpr std::string_view kPickleName = "data.pkl";

/// torch.save wrote plain pickles before version 1.6, and tar files before 0.1.10.
void refuse_old_formats(const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  std::string start(512, '\0');
  in.read(start.data(), static_cast<std::streamsize>(start.size()));
  start.resize(static_cast<std::size_t>(in.gcount()));
  const bool pickle = start.size() > 2 && start[0] == '\x80' && start[1] >= 1 && start[1] <= 5;
  const bool tar = start.size() > 262 && start.compare(257, 5, "ustar") == 0;
  if (pickle || tar) {
    throw NotSupportedError(
        file, "byte 0",
        "PyTorch's checkpoint format from before version 1.6; load the file in PyTorch 1.6 or newer "
        "and save it again with torch.save or as safetensors");
  }
}

/// <name>/data.pkl, where torch.save took <name> from the file, whatever that is called now.
const ZipMember& pickle_member(const ZipReader& archive) {
  const ZipMember* found = nullptr;
  for (const ZipMember& member : archive.members()) {
    const std::size_t slash = member.name.find('/');
    if (slash == std::string::npos || member.name.substr(slash + 1) != kPickleName) continue;
    if (found) throw InputError(archive.file(), member.name, "the archive has two data.pkl");
    found = &member;
  }
  if (!found) {
    throw InputError(archive.file(), "",
                     "a zip archive without <name>/data.pkl: not written by torch.save, or damaged");
  }
  return *found;
}

bool is_big_endian(const ZipReader& archive, const std::string& folder) {
  const ZipMember* member = archive.find(folder + "byteorder");
  if (!member) return false;  // older versions only ran on little-endian machines
  constexpr std::uint64_t kLongest = 16;
  if (member->bytes > kLongest) throw InputError(archive.file(), member->name, "neither 'little' nor 'big'");
  const std::string order = archive.read(*member);
  if (order != "little" && order != "big") throw InputError(archive.file(), member->name, "neither 'little' nor 'big'");
  return order == "big";
}

/// The archive with its pickle run and its storages not yet read.
class OpenArchive {
 public:
  explicit OpenArchive(const std::filesystem::path& path) : archive_(checked(path)), member_(pickle_member(archive_)) {
    document_ = pickle::load(archive_.read(member_), {archive_.file(), member_.name, 0, true});
  }

  const pickle::Value& root() const { return document_.root(); }
  /// @return nullptr unless the root is a dict with this key
  const pickle::Value* below(std::string_view key) const {
    if (root().kind != pickle::Kind::kDict) return nullptr;
    for (std::size_t i = 0; i + 1 < root().items.size(); i += 2) {
      const pickle::Value& found = *root().items[i];
      if (found.kind == pickle::Kind::kString && found.text == key) return root().items[i + 1];
    }
    return nullptr;
  }
  NpyPlace place() const { return {archive_.file(), member_.name}; }
  NamedArrays arrays(const pickle::Value& value, const std::string& prefix = {}) const {
    const std::string folder = member_.name.substr(0, member_.name.size() - kPickleName.size());
    std::vector<TorchLeaf> leaves = torch_leaves(value, place());
    const auto unwanted = [&](const TorchLeaf& leaf) { return leaf.name.rfind(prefix, 0) != 0; };
    leaves.erase(std::remove_if(leaves.begin(), leaves.end(), unwanted), leaves.end());
    return TorchStorages(archive_, folder, is_big_endian(archive_, folder)).materialize(leaves);
  }
  /// The weights: what is below "state_dict", else everything.
  const pickle::Value& state() const {
    const pickle::Value* found = below("state_dict");
    return found == nullptr ? root() : *found;
  }

 private:
  static const std::filesystem::path& checked(const std::filesystem::path& path) {
    refuse_old_formats(path.string());
    return path;
  }

  ZipReader archive_;
  const ZipMember& member_;
  pickle::Document document_;
};

}  // namespace

NamedArrays read_torch_archive(const std::filesystem::path& path) {
  const OpenArchive archive(path);
  return archive.arrays(archive.root());
}

TorchCheckpoint read_torch_checkpoint(const std::filesystem::path& path, const std::string& config_key) {
  const OpenArchive archive(path);
  const pickle::Value* config = archive.below(config_key);
  TorchCheckpoint checkpoint;
  checkpoint.state = archive.arrays(archive.state());
  if (config) checkpoint.config = plain_json(*config, archive.place());
  return checkpoint;
}

NamedArrays read_state_dict(const std::filesystem::path& path) {
  const std::string extension = path.extension().string();
  NamedArrays state;
  if (extension == ".safetensors") {
    state = read_safetensors(path).tensors;
  } else if (extension == ".pt" || extension == ".pth") {
    state = read_torch_archive(path);
  } else {
    throw NotSupportedError(path.string(), "", "checkpoints other than .pt, .pth and .safetensors");
  }
  constexpr std::string_view kPrefix = "module.";
  if (!state.empty() && state.front().first.compare(0, kPrefix.size(), kPrefix) == 0) {
    for (auto& entry : state) entry.first.erase(0, kPrefix.size());
  }
  return state;
}

NamedArrays read_state_below(const std::filesystem::path& path, const std::string& prefix) {
  NamedArrays state;
  if (path.extension() == ".safetensors") {
    state = read_safetensors(path, prefix).tensors;
  } else {
    const OpenArchive archive(path);
    state = archive.arrays(archive.state(), prefix);
  }
  for (auto& entry : state) entry.first.erase(0, prefix.size());
  return state;
}

}  // namespace anigen::io
