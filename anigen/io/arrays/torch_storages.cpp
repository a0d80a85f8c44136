#include "anigen/io/arrays/torch_storages.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <utility>

#include "anigen/core/error.h"

namespace anigen::io {
namespace {

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

}  // namespace

TorchStorages::TorchStorages(const ZipReader& archive, std::string folder, bool big_endian)
    : archive_(archive), folder_(std::move(folder)), big_endian_(big_endian) {
  std::uint64_t stored = 0;
  for (const ZipMember& member : archive.members()) stored += member.bytes;
  budget_ = 16 * stored + (std::uint64_t{64} << 20);
}

void TorchStorages::fail(const TorchLeaf& leaf, const std::string& problem) const {
  throw InputError(archive_.file(), "'" + leaf.name + "'", problem);
}

NamedArrays TorchStorages::materialize(const std::vector<TorchLeaf>& leaves) {
  for (const TorchLeaf& leaf : leaves) {
    if (leaf.value->kind != pickle::Kind::kTensor) continue;
    const pickle::Value& storage = *leaf.value->items[0];
    Shared& shared = shared_[std::string(storage.text)];
    if (shared.uses++ > 0 && (shared.dtype != storage.element.dtype || shared.count != storage.integer)) {
      fail(leaf, "storage " + std::string(storage.text) + " is described in two ways");
    }
    shared.dtype = storage.element.dtype;
    shared.count = storage.integer;
  }
  NamedArrays arrays;
  arrays.reserve(leaves.size());
  for (const TorchLeaf& leaf : leaves) {
    switch (leaf.value->kind) {
      case pickle::Kind::kTensor:
        arrays.emplace_back(leaf.name, tensor(leaf));
        break;
      case pickle::Kind::kBool:
        arrays.emplace_back(leaf.name, NdArray{Dtype::kBool, {}, {static_cast<std::uint8_t>(leaf.value->integer)}});
        break;
      case pickle::Kind::kInt:
        arrays.emplace_back(leaf.name, NdArray::from<std::int64_t>({leaf.value->integer}, {}));
        break;
      case pickle::Kind::kFloat:
        arrays.emplace_back(leaf.name, NdArray::from<double>({leaf.value->real}, {}));
        break;
      default:
        if (!leaf.value->array) fail(leaf, "a numpy array without content");
        if (leaf.value->array->bytes.size() > budget_) fail(leaf, "the arrays exceed by far what the file holds");
        budget_ -= leaf.value->array->bytes.size();
        arrays.emplace_back(leaf.name, *leaf.value->array);
    }
  }
  return arrays;
}

NdArray TorchStorages::tensor(const TorchLeaf& leaf) {
  const pickle::Value& view = *leaf.value;
  const pickle::Value& storage = *view.items[0];
  NdArray array;
  array.dtype = storage.element.dtype;
  array.shape = view.sizes;
  const std::size_t item = size_of(array.dtype);
  std::size_t count = 0;
  if (!count_elements(array.shape, item, count)) fail(leaf, "its shape overflows");
  std::uint64_t end = 0;
  if (count > 0 && (!last_element(view, end) || end > static_cast<std::uint64_t>(storage.integer))) {
    fail(leaf, "the tensor reaches beyond its storage of " + std::to_string(storage.integer) + " elements");
  }
  if (count * item > budget_) fail(leaf, "expanded tensors exceed by far what the file holds");
  budget_ -= count * item;

  Shared& shared = shared_.at(std::string(storage.text));
  if (!shared.loaded) {
    shared.bytes = load(storage);
    shared.loaded = true;
  }
  array.bytes.resize(count * item);
  if (count > 0 && is_contiguous(view)) {
    std::memcpy(array.bytes.data(), shared.bytes.data() + static_cast<std::size_t>(view.integer) * item, count * item);
  } else if (count > 0) {
    copy_strided(view, shared.bytes.data(), item, array.bytes);
  }
  if (--shared.uses == 0) std::string().swap(shared.bytes);
  return array;
}

std::string TorchStorages::load(const pickle::Value& storage) const {
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

}  // namespace anigen::io
