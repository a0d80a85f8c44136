#include "anigen/io/torch_archive.h"

#include <fstream>
#include <utility>

#include "anigen/core/error.h"
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

}  // namespace

NamedArrays read_torch_archive(const std::filesystem::path& path) {
  const std::string file = path.string();
  refuse_old_formats(file);
  const ZipReader archive(path);
  const ZipMember& member = pickle_member(archive);
  const std::string folder = member.name.substr(0, member.name.size() - kPickleName.size());
  const pickle::Document document = pickle::load(archive.read(member), {file, member.name, 0, true});
  const std::vector<TorchLeaf> leaves = torch_leaves(document.root(), {file, member.name});
  return TorchStorages(archive, folder, is_big_endian(archive, folder)).materialize(leaves);
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

}  // namespace anigen::io
