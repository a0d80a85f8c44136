#include "anigen/io/arrays/torch_archive.h"

#include <algorithm>
#include <cstring>
#include <fstream>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/io/arrays/row_quantization.h"
#include "anigen/io/arrays/safetensors.h"

namespace anigen::io {

namespace {

using pickle::Kind;

/// Something with numbers in it that a torch pickle holds, under its path joined with '.'.
struct TorchLeaf {
  std::string name;
  const pickle::Value* value;  ///< a tensor, a numpy array, or a bool, int or float
};

constexpr int kDeepestTree = 64;  // also ends cycles
constexpr std::size_t kMaxVisits = 10'000'000;

/// Walks dicts, lists and tuples in order. Strings, None, devices and dtypes are left out.
class Walker {
 public:
  explicit Walker(const NpyPlace& place) : place_(place) {}

  void visit(const pickle::Value& value, const std::string& name, int depth) {
    if (depth > kDeepestTree)
      place_.fail("objects are nested too deeply, or contain themselves, at '" + name.substr(0, 80) + "'");
    if (++visits_ > kMaxVisits) place_.fail("too many objects");
    if (value.kind == Kind::kGlobal || value.kind == Kind::kStorage) {
      place_.refuse(std::string("a bare ") + pickle::name_of(value.kind) + " at '" + name + "'");
    }
    constexpr Kind kLeaves[] = {Kind::kTensor, Kind::kArray, Kind::kBool, Kind::kInt, Kind::kFloat};
    if (std::find(std::begin(kLeaves), std::end(kLeaves), value.kind) != std::end(kLeaves)) {
      if (!names_.insert(name).second) place_.fail("two values have the path '" + name + "'");
      leaves.push_back({name, &value});
      return;
    }
    const bool dict = value.kind == Kind::kDict;
    const std::size_t step = dict ? 2 : 1;
    for (std::size_t i = 0; i + step <= value.items.size(); i += step) {
      const std::string part = dict ? key(*value.items[i]) : std::to_string(i);
      visit(*value.items[i + step - 1], name.empty() ? part : name + "." + part, depth + 1);
    }
  }

  std::vector<TorchLeaf> leaves;

 private:
  std::string key(const pickle::Value& key) const {
    if (key.kind == Kind::kString || key.kind == Kind::kBytes) return std::string(key.text);
    if (key.kind == Kind::kInt || key.kind == Kind::kBool) return std::to_string(key.integer);
    place_.refuse(std::string("a dict key that is a ") + pickle::name_of(key.kind));
  }

  const NpyPlace& place_;
  std::unordered_set<std::string> names_;
  std::size_t visits_ = 0;
};

/// One past the last element a view touches; false when that overflows.
bool last_element(const pickle::Value& tensor, std::uint64_t& end) {
  constexpr std::uint64_t kMost = std::uint64_t{1} << 62;
  end = static_cast<std::uint64_t>(tensor.integer);
  for (std::size_t d = 0; d < tensor.sizes.size(); ++d) {
    const auto steps = static_cast<std::uint64_t>(tensor.sizes[d] - 1);
    const auto stride = static_cast<std::uint64_t>(tensor.strides[d]);
    if (stride != 0 && steps > kMost / stride) return false;
    end += steps * stride;
    if (end > kMost) return false;
  }
  ++end;
  return true;
}

bool is_contiguous(const pickle::Value& tensor) {
  std::int64_t expected = 1;
  for (std::size_t d = tensor.sizes.size(); d-- > 0;) {
    if (tensor.sizes[d] == 1) continue;
    if (tensor.strides[d] != expected) return false;
    expected *= tensor.sizes[d];
  }
  return true;
}

void copy_strided(const pickle::Value& tensor, const char* storage, std::size_t item, std::vector<std::uint8_t>& out) {
  const std::size_t rank = tensor.sizes.size();
  std::vector<std::int64_t> index(rank, 0);
  auto source = static_cast<std::size_t>(tensor.integer);
  for (std::size_t at = 0; at < out.size(); at += item) {
    std::memcpy(out.data() + at, storage + source * item, item);
    for (std::size_t d = rank; d-- > 0;) {
      source += static_cast<std::size_t>(tensor.strides[d]);
      if (++index[d] < tensor.sizes[d]) break;
      source -= static_cast<std::size_t>(tensor.strides[d]) * static_cast<std::size_t>(tensor.sizes[d]);
      index[d] = 0;
    }
  }
}

/// The data/<key> members of a torch archive. Tensors are views into them: several may share one storage (training
/// checkpoints keep all trainable parameters in one flat buffer), each storage is read once and freed after its last
/// use.
class TorchStorages {
 public:
  TorchStorages(const ZipReader& archive, std::string folder, bool big_endian)
      : archive_(archive), folder_(std::move(folder)), big_endian_(big_endian) {
    std::uint64_t stored = 0;
    for (const ZipMember& member : archive.members()) stored += member.bytes;
    budget_ = 16 * stored + (std::uint64_t{64} << 20);
  }

  /// Contiguous copies in the order of the leaves. @throws InputError for views beyond their storage and storages
  /// whose length disagrees with the pickle
  void visit(const std::vector<TorchLeaf>& leaves, const ArrayVisitor& visitor) {
    for (const TorchLeaf& leaf : leaves) {
      if (leaf.value->kind != Kind::kTensor) continue;
      const pickle::Value& storage = *leaf.value->items[0];
      Shared& shared = shared_[std::string(storage.text)];
      if (shared.uses++ > 0 && (shared.dtype != storage.element.dtype || shared.count != storage.integer))
        fail(leaf, "storage " + std::string(storage.text) + " is described in two ways");
      shared.dtype = storage.element.dtype;
      shared.count = storage.integer;
    }
    for (const TorchLeaf& leaf : leaves) visitor(leaf.name, array(leaf));
  }

 private:
  NdArray array(const TorchLeaf& leaf) {
    const pickle::Value& value = *leaf.value;
    if (value.kind == Kind::kTensor) return tensor(leaf);
    if (value.kind == Kind::kBool) return {Dtype::kBool, {}, {static_cast<std::uint8_t>(value.integer)}};
    if (value.kind == Kind::kInt) return NdArray::from<std::int64_t>({value.integer}, {});
    if (value.kind == Kind::kFloat) return NdArray::from<double>({value.real}, {});
    if (!value.array) fail(leaf, "a numpy array without content");
    if (value.array->bytes.size() > budget_) fail(leaf, "the arrays exceed by far what the file holds");
    budget_ -= value.array->bytes.size();
    return *value.array;
  }

  NdArray tensor(const TorchLeaf& leaf) {
    const pickle::Value& view = *leaf.value;
    const pickle::Value& storage = *view.items[0];
    NdArray array;
    array.dtype = storage.element.dtype;
    array.shape = view.sizes;
    const std::size_t item = size_of(array.dtype);
    std::size_t count = 0;
    if (!count_elements(array.shape, item, count)) fail(leaf, "its shape overflows");
    std::uint64_t end = 0;
    if (count > 0 && (!last_element(view, end) || end > static_cast<std::uint64_t>(storage.integer)))
      fail(leaf, "the tensor reaches beyond its storage of " + std::to_string(storage.integer) + " elements");
    if (count * item > budget_) fail(leaf, "expanded tensors exceed by far what the file holds");
    budget_ -= count * item;

    Shared& shared = shared_.at(std::string(storage.text));
    if (!shared.loaded) {
      shared.bytes = load(storage);
      shared.loaded = true;
    }
    array.bytes.resize(count * item);
    if (count > 0 && is_contiguous(view)) {
      std::memcpy(array.bytes.data(), shared.bytes.data() + static_cast<std::size_t>(view.integer) * item,
                  count * item);
    } else if (count > 0) {
      copy_strided(view, shared.bytes.data(), item, array.bytes);
    }
    if (--shared.uses == 0) std::string().swap(shared.bytes);
    return array;
  }

  std::string load(const pickle::Value& storage) const {
    const std::string name = folder_ + "data/" + std::string(storage.text);
    const ZipMember* member = archive_.find(name);
    if (!member) throw InputError(archive_.file(), name, "the pickle refers to this storage, which the archive lacks");
    const std::size_t item = size_of(storage.element.dtype);
    if (member->bytes % item != 0 || member->bytes / item != static_cast<std::uint64_t>(storage.integer)) {
      throw InputError(archive_.file(), name,
                       "holds " + std::to_string(member->bytes) + " bytes, and the pickle says " +
                           std::to_string(storage.integer) + " elements of " + std::to_string(item));
    }
    std::string bytes = archive_.read(*member);
    if (big_endian_) {
      for (std::size_t i = 0; i < bytes.size(); i += item) {
        std::reverse(bytes.begin() + static_cast<std::ptrdiff_t>(i),
                     bytes.begin() + static_cast<std::ptrdiff_t>(i + item));
      }
    }
    return bytes;
  }

  [[noreturn]] void fail(const TorchLeaf& leaf, const std::string& problem) const {
    throw InputError(archive_.file(), "'" + leaf.name + "'", problem);
  }

  const ZipReader& archive_;
  std::string folder_;
  bool big_endian_;
  struct Shared {
    std::string bytes;
    bool loaded = false;
    std::size_t uses = 0;
    Dtype dtype = Dtype::kF32;
    std::int64_t count = 0;
  };
  std::unordered_map<std::string, Shared> shared_;
  std::uint64_t budget_;  // stride 0 lets a tiny storage stand for a huge tensor
};

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

const std::filesystem::path& checked(const std::filesystem::path& path) {
  refuse_old_formats(path.string());
  return path;
}

/// The weights: what is below "state_dict", else everything.
const pickle::Value& state_of(const TorchFile& file) {
  const pickle::Value* found = find(file.root(), "state_dict");
  return found == nullptr ? file.root() : *found;
}

// Plain values: None, booleans, numbers and texts, lists and tuples of them, dicts of them by text or integer.
// Everything else becomes null, an entry of a dict by another kind of key is left out.
constexpr int kDeepestJson = 64;  // also ends cycles
constexpr std::size_t kMostJsonValues = 1'000'000;

class PlainValues {
 public:
  explicit PlainValues(NpyPlace place) : place_(std::move(place)) {}

  Json visit(const pickle::Value& value, int depth) {
    if (depth > kDeepestJson) place_.fail("objects are nested too deeply, or contain themselves");
    if (++visits_ > kMostJsonValues) place_.fail("too many objects");
    if (value.kind == Kind::kBool) return value.integer != 0;
    if (value.kind == Kind::kInt) return value.integer;
    if (value.kind == Kind::kFloat) return value.real;
    if (value.kind == Kind::kString) return std::string(value.text);
    Json result;
    if (value.kind == Kind::kList || value.kind == Kind::kTuple) {
      result = Json::array();
      for (const pickle::Value* item : value.items) result.push_back(visit(*item, depth + 1));
    } else if (value.kind == Kind::kDict) {
      result = Json::object();
      for (std::size_t i = 0; i + 1 < value.items.size(); i += 2) {
        const pickle::Value& key = *value.items[i];
        const bool is_text = key.kind == Kind::kString;
        if (!is_text && key.kind != Kind::kInt) continue;
        result[is_text ? std::string(key.text) : std::to_string(key.integer)] = visit(*value.items[i + 1], depth + 1);
      }
    }
    return result;
  }

 private:
  NpyPlace place_;
  std::size_t visits_ = 0;
};

// Tensors whose names begin with `prefix`; those in eight bits as fp32.
void visit_safetensors(const std::filesystem::path& path, const std::string& prefix, const ArrayVisitor& visit) {
  SafetensorsReader reader(path);
  const std::vector<std::string> names = reader.names();
  std::unordered_map<std::string, std::size_t> places;
  for (std::size_t i = 0; i < names.size(); ++i) places[names[i]] = i;
  std::unordered_map<std::size_t, std::size_t> scales;  // of arrays in eight bits
  std::unordered_set<std::size_t> used;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto found = places.find(names[i] + kRowScaleSuffix);
    if (reader.dtype(i) != Dtype::kI8 || found == places.end()) continue;
    scales[i] = found->second;
    used.insert(found->second);
  }
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (names[i].rfind(prefix, 0) != 0 || used.count(i) > 0) continue;
    const auto found = scales.find(i);
    NdArray array = reader.read(i);
    if (found != scales.end()) array = dequantized(array, reader.read(found->second), path.string(), names[i]);
    visit(names[i], std::move(array));
  }
}

}  // namespace

const pickle::Value* find(const pickle::Value& dict, std::string_view key) {
  for (std::size_t i = 0; dict.kind == Kind::kDict && i + 1 < dict.items.size(); i += 2) {
    if (dict.items[i]->kind == Kind::kString && dict.items[i]->text == key) return dict.items[i + 1];
  }
  return nullptr;
}

TorchFile::TorchFile(const std::filesystem::path& path) : archive_(checked(path)), member_(pickle_member(archive_)) {
  document_ = pickle::load(archive_.read(member_), {archive_.file(), member_.name, 0, true});
}

NamedArrays TorchFile::arrays(const pickle::Value& value, const std::string& prefix) const {
  NamedArrays arrays;
  visit(value, prefix, [&](const std::string& key, NdArray&& array) { arrays.emplace_back(key, std::move(array)); });
  return arrays;
}

void TorchFile::visit(const pickle::Value& value, const std::string& prefix, const ArrayVisitor& visitor) const {
  const std::string folder = member_.name.substr(0, member_.name.size() - kPickleName.size());
  const NpyPlace here = place();
  Walker walker(here);
  walker.visit(value, "", 0);
  const auto unwanted = [&](const TorchLeaf& leaf) { return leaf.name.rfind(prefix, 0) != 0; };
  walker.leaves.erase(std::remove_if(walker.leaves.begin(), walker.leaves.end(), unwanted), walker.leaves.end());
  TorchStorages(archive_, folder, is_big_endian(archive_, folder)).visit(walker.leaves, visitor);
}

NamedArrays read_torch_archive(const std::filesystem::path& path) {
  const TorchFile file(path);
  return file.arrays(file.root());
}

TorchCheckpoint read_torch_checkpoint(const std::filesystem::path& path, const std::string& config_key) {
  const TorchFile file(path);
  const pickle::Value* config = find(file.root(), config_key);
  TorchCheckpoint checkpoint;
  checkpoint.state = file.arrays(state_of(file));
  if (config) checkpoint.config = PlainValues(file.place()).visit(*config, 0);
  return checkpoint;
}

NamedArrays read_state_dict(const std::filesystem::path& path) {
  NamedArrays state;
  visit_state_dict(path, [&](const std::string& key, NdArray&& array) { state.emplace_back(key, std::move(array)); });
  return state;
}

void visit_state_dict(const std::filesystem::path& path, const ArrayVisitor& visit) {
  constexpr std::string_view kPrefix = "module.";
  bool first = true, prefixed = false;
  const ArrayVisitor without_prefix = [&](const std::string& key, NdArray&& array) {
    if (first) prefixed = key.compare(0, kPrefix.size(), kPrefix) == 0;
    first = false;
    visit(prefixed ? key.substr(std::min(kPrefix.size(), key.size())) : key, std::move(array));
  };
  const std::string extension = path.extension().string();
  if (extension == ".safetensors") {
    visit_safetensors(path, "", without_prefix);
  } else if (extension == ".pt" || extension == ".pth") {
    const TorchFile file(path);
    file.visit(file.root(), "", without_prefix);
  } else {
    throw NotSupportedError(path.string(), "", "checkpoints other than .pt, .pth and .safetensors");
  }
}

NamedArrays read_state_below(const std::filesystem::path& path, const std::string& prefix) {
  NamedArrays state;
  const ArrayVisitor keep = [&](const std::string& key, NdArray&& array) {
    state.emplace_back(key.substr(prefix.size()), std::move(array));
  };
  if (path.extension() == ".safetensors") {
    visit_safetensors(path, prefix, keep);
  } else {
    const TorchFile file(path);
    file.visit(state_of(file), prefix, keep);
  }
  return state;
}

}  // namespace anigen::io
