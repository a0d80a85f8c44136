#include "anigen/io/arrays/npz_objects.h"

#include <algorithm>
#include <limits>
#include <set>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/arrays/pickle.h"

namespace anigen::io {

namespace {

constexpr int kMaxDepth = 32;  // of Python objects inside each other; also ends cycles

/// Copies the values of a pickle into a tree. An object that is reachable twice appears twice, so the number of
/// copies and their bytes are bounded by what the pickle could hold once, several times over.
class TreeBuilder {
 public:
  TreeBuilder(const NpyPlace& place, std::size_t pickle_bytes)
      : place_(place), budget_(16 * pickle_bytes + (1 << 20)) {}

  NpzValue value(const pickle::Value& from, int depth = 0) {
    if (depth > kMaxDepth) place_.fail("objects are nested too deeply, or contain themselves");
    spend(1 + from.text.size());
    if (from.kind == pickle::Kind::kObjectArray) return nested(from, depth);
    // In the order of pickle::Kind, as far as arrays hold them.
    using Kind = NpzValue::Kind;
    static constexpr Kind kKinds[] = {Kind::kNone,   Kind::kBool,   Kind::kInteger, Kind::kReal,
                                      Kind::kString, Kind::kString, Kind::kList,    Kind::kList,
                                      Kind::kList,   Kind::kDict,   Kind::kArray};
    if (static_cast<std::size_t>(from.kind) >= std::size(kKinds)) {
      place_.refuse(from.text.empty() ? std::string("a ") + pickle::name_of(from.kind) + " in an array"
                                      : std::string(from.text) + " in an array");
    }
    NpzValue to;
    to.kind = kKinds[static_cast<std::size_t>(from.kind)];
    to.integer = from.integer;
    to.real = from.real;
    to.text = std::string(from.text);
    if (to.kind == Kind::kArray) {
      if (!from.array) place_.fail("a numpy array without content");
      spend(from.array->bytes.size());
      to.array = *from.array;
    }
    for (std::size_t i = 0; i < from.items.size(); ++i) {
      if (to.kind == Kind::kDict && i % 2 == 0)
        to.keys.push_back(key(*from.items[i]));
      else
        to.items.push_back(value(*from.items[i], depth + 1));
    }
    check_unique(to.keys);
    return to;
  }

  /// Items of a row-major object array as lists of lists by its shape.
  NpzValue nested(const pickle::Value& array, int depth) {
    return level(array.sizes, array.items, 0, 0, array.items.size(), depth);
  }

 private:
  void spend(std::size_t bytes) {
    if (bytes > budget_) place_.fail("shared objects expand to far more than the file holds");
    budget_ -= bytes;
  }

  std::string key(const pickle::Value& from) const {
    if (from.kind == pickle::Kind::kString || from.kind == pickle::Kind::kBytes) return std::string(from.text);
    if (from.kind == pickle::Kind::kInt) return std::to_string(from.integer);
    place_.refuse(std::string("a dict key that is a ") + pickle::name_of(from.kind));
  }

  void check_unique(const std::vector<std::string>& keys) const {
    std::set<std::string_view> seen;
    for (const std::string& key : keys) {
      if (!seen.insert(key).second) place_.fail("key '" + key + "' appears twice in a dict");
    }
  }

  NpzValue level(const std::vector<std::int64_t>& sizes, const std::vector<pickle::Value*>& items, std::size_t axis,
                 std::size_t first, std::size_t count, int depth) {
    if (depth > kMaxDepth) place_.fail("objects are nested too deeply, or contain themselves");
    if (axis == sizes.size()) return value(*items.at(first), depth);
    NpzValue list;
    list.kind = NpzValue::Kind::kList;
    const auto size = count == 0 ? std::size_t{0} : static_cast<std::size_t>(sizes[axis]);
    for (std::size_t i = 0; i < size; ++i) {
      const std::size_t step = count / size;
      list.items.push_back(level(sizes, items, axis + 1, first + i * step, step, depth + 1));
    }
    return list;
  }

  const NpyPlace& place_;
  std::size_t budget_;
};

bool is_number(const NpzValue& value) {
  return value.kind == NpzValue::Kind::kBool || value.kind == NpzValue::Kind::kInteger ||
         value.kind == NpzValue::Kind::kReal;
}

/// A list (of lists) of numbers and None as an array. @return false when it holds anything else or is ragged
class NumberGatherer {
 public:
  explicit NumberGatherer(const NpzValue& list) : fits_(gather(list, 0)) {}

  bool fits() const { return fits_ && !(real_ && none_); }

  NdArray array() const { return real_ ? NdArray::from(reals_, shape_) : NdArray::from(integers_, shape_); }

 private:
  bool gather(const NpzValue& value, std::size_t axis) {
    if (value.kind == NpzValue::Kind::kList) {
      const auto size = static_cast<std::int64_t>(value.items.size());
      if (leaf_axis_ != kUnknown && axis >= leaf_axis_) return false;
      if (axis == shape_.size()) shape_.push_back(size);
      if (shape_[axis] != size) return false;
      return std::all_of(value.items.begin(), value.items.end(),
                         [&](const NpzValue& item) { return gather(item, axis + 1); });
    }
    if (value.kind != NpzValue::Kind::kNone && !is_number(value)) return false;
    if (leaf_axis_ == kUnknown) leaf_axis_ = axis;
    if (axis != leaf_axis_ || axis != shape_.size()) return false;
    none_ = none_ || value.kind == NpzValue::Kind::kNone;
    real_ = real_ || value.kind == NpzValue::Kind::kReal;
    integers_.push_back(value.kind == NpzValue::Kind::kNone ? -1 : value.integer);
    reals_.push_back(value.kind == NpzValue::Kind::kReal ? value.real : static_cast<double>(value.integer));
    return true;
  }

  static constexpr std::size_t kUnknown = std::numeric_limits<std::size_t>::max();
  std::size_t leaf_axis_ = kUnknown;
  std::vector<std::int64_t> shape_, integers_;
  std::vector<double> reals_;
  bool none_ = false, real_ = false;
  bool fits_;
};

/// True when there is an array or dict somewhere, whose entries deserve names of their own.
bool has_structure(const NpzValue& value) {
  if (value.kind == NpzValue::Kind::kArray || value.kind == NpzValue::Kind::kDict) return true;
  return std::any_of(value.items.begin(), value.items.end(), has_structure);
}

bool holds_text(const NpzValue& value) {
  return value.kind == NpzValue::Kind::kString || std::any_of(value.items.begin(), value.items.end(), holds_text);
}

void append_leaves(const NpzValue& value, const std::string& name, NamedArrays& out) {
  using Kind = NpzValue::Kind;
  const bool dict = value.kind == Kind::kDict, list = value.kind == Kind::kList;
  const NumberGatherer numbers(value);
  if (value.kind == Kind::kBool) {
    out.emplace_back(name, NdArray{Dtype::kBool, {}, {static_cast<std::uint8_t>(value.integer)}});
  } else if (value.kind == Kind::kArray) {
    out.emplace_back(name, value.array);
  } else if (is_number(value) || (list && numbers.fits())) {
    out.emplace_back(name, numbers.array());
  } else if (dict || list) {
    for (std::size_t i = 0; i < value.items.size(); ++i)
      append_leaves(value.items[i], name + "." + (dict ? value.keys[i] : std::to_string(i)), out);
  }
}

}  // namespace

const NpzValue* NpzValue::find(const std::string& key) const {
  const auto found = std::find(keys.begin(), keys.end(), key);
  return found == keys.end() ? nullptr : &items[static_cast<std::size_t>(found - keys.begin())];
}

NpzValue unpickle_object_array(std::string pickle, const std::vector<std::int64_t>& shape, std::size_t first_byte,
                               const NpyPlace& place) {
  const std::size_t bytes = pickle.size();
  const pickle::Document document = pickle::load(std::move(pickle), {place.file, place.member, first_byte, false});
  const pickle::Value& root = document.root();
  if (root.kind != pickle::Kind::kObjectArray || root.sizes != shape)
    place.fail("its pickle is not the object array that its header announces");
  return TreeBuilder(place, bytes).nested(root, 0);
}

NpzValue object_tree(const pickle::Value& value, std::size_t pickle_bytes, const NpyPlace& place) {
  return TreeBuilder(place, pickle_bytes).value(value);
}

NpzValue decode_text_array(const NpyHeader& header, const std::string& raw, const NpyPlace& place) {
  const std::size_t size = header.element.size;
  std::size_t count = 0;
  if (!count_elements(header.shape, std::max<std::size_t>(size, 1), count) || raw.size() != count * size)
    place.fail("its shape does not fit its data");
  if (header.fortran_order && header.shape.size() > 1) place.refuse("text arrays in Fortran order");
  if (size == 0 && count > 0) place.refuse("text of no width");
  // Shapes become lists as for objects: wrap the decoded texts as pickle values.
  std::vector<std::string> texts(count);
  pickle::Value array;
  std::vector<pickle::Value> values(count);
  for (std::size_t i = 0; i < count; ++i) {
    texts[i] = decode_npy_text(header.element, std::string_view(raw).substr(i * size, size), place);
    values[i].kind = pickle::Kind::kString;
    values[i].text = texts[i];
    array.items.push_back(&values[i]);
  }
  array.sizes = header.shape;
  return TreeBuilder(place, raw.size()).nested(array, 0);
}

void append_numeric_leaves(const NpzValue& value, const std::string& name, const NpyPlace& place, NamedArrays& out) {
  const bool plain = !has_structure(value);
  const bool text = plain && holds_text(value);
  const bool flat = std::none_of(value.items.begin(), value.items.end(),
                                 [](const NpzValue& item) { return item.kind == NpzValue::Kind::kList; });
  const bool unfit = value.kind == NpzValue::Kind::kList && plain && flat && !NumberGatherer(value).fits();
  if (text || unfit || value.kind == NpzValue::Kind::kNone) {
    place.refuse("text or mixed objects as numbers (read_npz_objects gives them as they are)");
  }
  append_leaves(value, name, out);
}

}  // namespace anigen::io
