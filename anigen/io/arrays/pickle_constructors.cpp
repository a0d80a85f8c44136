#include "anigen/io/arrays/pickle_constructors.h"

#include <algorithm>
#include <array>
#include <utility>

#include "anigen/core/error.h"

namespace anigen::io::pickle {

namespace {

// The names a pickle may refer to. Storages and torch dtypes carry a Dtype.
enum class Global {
  kOrderedDict,
  kNumpyReconstruct,
  kNumpyScalar,
  kNumpyFromBuffer,
  kNumpyArray,
  kNumpyDtype,
  kCodecsEncode,
  kRebuildTensor,
  kRebuildParameter,
  kTorchSize,
  kTorchDevice,
  kTorchStorage,
  kTorchDtype
};

struct AllowedName {
  std::string_view module, name;
  Global global;
};
// numpy 2 renamed its private package to numpy._core; both spellings are in circulation.
constexpr std::array<AllowedName, 14> kAllowed = {
    {{"collections", "OrderedDict", Global::kOrderedDict},
     {"numpy.core.multiarray", "_reconstruct", Global::kNumpyReconstruct},
     {"numpy._core.multiarray", "_reconstruct", Global::kNumpyReconstruct},
     {"numpy.core.multiarray", "scalar", Global::kNumpyScalar},
     {"numpy._core.multiarray", "scalar", Global::kNumpyScalar},
     {"numpy.core.numeric", "_frombuffer", Global::kNumpyFromBuffer},
     {"numpy._core.numeric", "_frombuffer", Global::kNumpyFromBuffer},
     {"numpy", "ndarray", Global::kNumpyArray},
     {"numpy", "dtype", Global::kNumpyDtype},
     {"_codecs", "encode", Global::kCodecsEncode},
     {"torch._utils", "_rebuild_tensor_v2", Global::kRebuildTensor},
     {"torch._utils", "_rebuild_parameter", Global::kRebuildParameter},
     {"torch", "Size", Global::kTorchSize},
     {"torch", "device", Global::kTorchDevice}}};

// False when the name is not on the list. @param dtype of a torch storage
bool find_global(std::string_view module, std::string_view name, Global& global, Dtype& dtype) {
  for (const AllowedName& entry : kAllowed) {
    if (entry.module == module && entry.name == name) {
      global = entry.global;
      return true;
    }
  }
  if (module != "torch") return false;
  if (const auto storage = find_dtype(&DtypeWords::torch_storage, name)) {
    global = Global::kTorchStorage;
    dtype = *storage;
    return true;
  }
  const auto named = find_dtype(&DtypeWords::name, name);
  if (!named || words_of(*named).torch_storage.empty()) return false;
  global = Global::kTorchDtype;
  return true;
}

constexpr std::size_t kMaxValues = 20'000'000;
constexpr std::size_t kArrayAllowance = std::size_t{1} << 20;

bool is_text(const Value& value) { return value.kind == Kind::kString || value.kind == Kind::kBytes; }

}  // namespace

const char* name_of(Kind kind) {
  static constexpr const char* kNames[] = {
      "None",        "bool",   "int",           "float",        "str",          "bytes",
      "list",        "tuple",  "set",           "dict",         "numpy array",  "numpy object array",
      "numpy dtype", "global", "torch storage", "torch tensor", "opaque object"};
  return kNames[static_cast<int>(kind)];
}

Constructors::Constructors(Document& document, const Source& source, std::uint64_t pickle_bytes,
                           std::function<std::string()> place)
    : document_(document),
      source_(source),
      place_(std::move(place)),
      array_budget_(4 * pickle_bytes + kArrayAllowance) {}

void Constructors::fail(const std::string& problem) const { throw InputError(source_.file, place_(), problem); }
void Constructors::refuse(const std::string& feature) const {
  throw NotSupportedError(source_.file, place_(), feature);
}

Value* Constructors::make(Kind kind) {
  if (document_.values_.size() >= kMaxValues) fail("the pickle holds too many objects");
  document_.values_.emplace_back();
  document_.values_.back().kind = kind;
  return &document_.values_.back();
}

std::string_view Constructors::keep(std::string text) {
  document_.texts_.push_back(std::move(text));
  return document_.texts_.back();
}

Value* Constructors::global(std::string_view module, std::string_view name) {
  Global found{};
  Dtype dtype = Dtype::kF32;
  if (!find_global(module, name, found, dtype)) {
    refuse("pickled '" + std::string(module) + "." + std::string(name) +
           "' (only plain data, numpy arrays and torch tensors are read)");
  }
  const bool torch_dtype = found == Global::kTorchDtype;
  Value* value = make(torch_dtype ? Kind::kOpaque : Kind::kGlobal);
  value->text = name;
  value->global = static_cast<int>(found);
  value->element.dtype = dtype;
  return value;
}

const Value& Constructors::argument(const Value& arguments, std::size_t index, Kind kind) const {
  if (index >= arguments.items.size()) fail("too few arguments for a constructor");
  const Value& value = *arguments.items[index];
  if (value.kind != kind) {
    fail("argument " + std::to_string(index) + " of a constructor is a " + name_of(value.kind) + ", not a " +
         name_of(kind));
  }
  return value;
}

std::vector<std::int64_t> Constructors::sizes(const Value& value) const {
  std::vector<std::int64_t> sizes;
  if (value.kind == Kind::kInt) return {value.integer};
  if (value.kind != Kind::kTuple && value.kind != Kind::kList) fail("a shape that is not a tuple");
  constexpr std::size_t kMaxDimensions = 64;
  if (value.items.size() > kMaxDimensions) fail("more than 64 dimensions");
  for (const Value* item : value.items) {
    if (item->kind != Kind::kInt || item->integer < 0) fail("a shape or stride that is not a size");
    sizes.push_back(item->integer);
  }
  return sizes;
}

void Constructors::spend(std::size_t bytes) {
  if (bytes > array_budget_) fail("the arrays are larger than the pickle that holds them");
  array_budget_ -= bytes;
}

Value* Constructors::call(const Value& function, const Value& arguments) {
  if (function.kind != Kind::kGlobal) fail(std::string("calls a ") + name_of(function.kind));
  if (arguments.kind != Kind::kTuple) fail("the arguments of a call are not a tuple");
  const auto global = static_cast<Global>(function.global);
  const std::vector<Value*>& items = arguments.items;
  if (global == Global::kOrderedDict) return ordered_dict(arguments);
  if (global == Global::kNumpyReconstruct) return make(Kind::kArray);  // without content until BUILD
  if (global == Global::kCodecsEncode) return encode(arguments);
  if (global == Global::kRebuildTensor) return tensor(arguments);
  if (global == Global::kNumpyScalar) {
    const Value& dtype = argument(arguments, 0, Kind::kDtype);
    if (items.size() != 2 || !is_text(*items[1])) fail("a numpy scalar without its bytes");
    return scalar(dtype, items[1]->text);
  }
  if (global == Global::kNumpyFromBuffer) {
    if (items.size() != 4 || !is_text(*items[3])) fail("_frombuffer needs four arguments");
    Value* array = make(Kind::kArray);
    fill_array(*array, *items[2], argument(arguments, 1, Kind::kDtype), items[3]->text == "F", *items[0]);
    return array;
  }
  if (global == Global::kNumpyDtype) {
    if (items.empty() || !is_text(*items[0])) fail("a numpy dtype without its name");
    Value* dtype = make(Kind::kDtype);
    dtype->element = parse_npy_element(items[0]->text, {source_.file, place_()});
    return dtype;
  }
  if (global == Global::kRebuildParameter) {
    argument(arguments, 0, Kind::kTensor);
    return items[0];
  }
  if (global == Global::kTorchSize) {
    Value* tuple = make(Kind::kTuple);
    for (const std::int64_t size : items.empty() ? std::vector<std::int64_t>() : sizes(*items[0])) {
      tuple->items.push_back(make(Kind::kInt));
      tuple->items.back()->integer = size;
    }
    return tuple;
  }
  if (global == Global::kTorchDevice) {
    Value* device = make(Kind::kOpaque);
    device->text = "torch.device";
    return device;
  }
  refuse("calling '" + std::string(function.text) + "' in a pickle");
}

Value* Constructors::ordered_dict(const Value& arguments) {
  Value* dict = make(Kind::kDict);
  if (arguments.items.empty()) return dict;
  const Value& pairs = argument(arguments, 0, Kind::kList);  // Python 2 passed the items here
  spend(2 * sizeof(void*) * pairs.items.size());
  for (const Value* pair : pairs.items) {
    if ((pair->kind != Kind::kList && pair->kind != Kind::kTuple) || pair->items.size() != 2)
      fail("an OrderedDict from something other than pairs");
    dict->items.insert(dict->items.end(), pair->items.begin(), pair->items.end());
  }
  return dict;
}

Value* Constructors::scalar(const Value& dtype, std::string_view raw) {
  if (dtype.element.kind == NpyElement::Kind::kObject) refuse("numpy object scalars in a pickle");
  if (raw.size() != dtype.element.size) fail("a numpy scalar of the wrong size");
  if (dtype.element.kind != NpyElement::Kind::kNumber) {
    spend(raw.size());
    Value* text = make(Kind::kString);
    text->text = keep(decode_npy_text(dtype.element, raw, {source_.file, place_()}));
    return text;
  }
  const NdArray array = decode_npy({dtype.element, false, {}}, {raw.begin(), raw.end()}, {source_.file, place_()});
  const bool real = array.dtype == Dtype::kF16 || array.dtype == Dtype::kF32 || array.dtype == Dtype::kF64;
  Value* value = make(real ? Kind::kFloat : array.dtype == Dtype::kBool ? Kind::kBool : Kind::kInt);
  if (real) {
    value->real = array.as<double>()[0];
  } else if (array.dtype == Dtype::kU64 && array.as<std::uint64_t>()[0] >> 63) {
    value->kind = Kind::kOpaque;
    value->text = "an integer beyond 64 bits";
  } else {
    value->integer = array.as<std::int64_t>()[0];
  }
  return value;
}

Value* Constructors::encode(const Value& arguments) {
  // Python 3 writes bytes at protocols below 3 as text to be encoded as Latin-1.
  const std::string_view text = argument(arguments, 0, Kind::kString).text;
  const std::string_view codec = argument(arguments, 1, Kind::kString).text;
  if (codec != "latin1" && codec != "latin-1") refuse("text encoding '" + std::string(codec) + "' in a pickle");
  spend(text.size());
  std::string bytes;
  bytes.reserve(text.size());
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto first = static_cast<unsigned char>(text[i]);
    if (first < 0x80) {
      bytes += static_cast<char>(first);
    } else if ((first == 0xC2 || first == 0xC3) && i + 1 < text.size()) {
      bytes += static_cast<char>((first & 3u) << 6 | (static_cast<unsigned char>(text[++i]) & 0x3Fu));
    } else {
      fail("text that is not Latin-1");
    }
  }
  Value* value = make(Kind::kBytes);
  value->text = keep(std::move(bytes));
  return value;
}

Value* Constructors::tensor(const Value& arguments) {
  Value* tensor = make(Kind::kTensor);
  argument(arguments, 0, Kind::kStorage);
  tensor->items.push_back(arguments.items[0]);
  tensor->integer = argument(arguments, 1, Kind::kInt).integer;
  tensor->sizes = sizes(argument(arguments, 2, Kind::kTuple));
  tensor->strides = sizes(argument(arguments, 3, Kind::kTuple));
  if (tensor->sizes.size() != tensor->strides.size() || tensor->integer < 0) fail("a tensor with impossible strides");
  return tensor;
}

Value* Constructors::persistent(const Value& id) {
  if (!source_.torch_storages) refuse("persistent ids in this pickle");
  if (id.kind != Kind::kTuple || id.items.size() < 5) fail("a persistent id that is not a torch storage");
  const Value& kind = argument(id, 0, Kind::kString);
  const Value& type = argument(id, 1, Kind::kGlobal);
  if (kind.text != "storage" || static_cast<Global>(type.global) != Global::kTorchStorage)
    fail("a persistent id that is not a torch storage");
  if (id.items.size() > 5 && id.items[5]->kind != Kind::kNone) refuse("torch storages that are views of others");
  Value* storage = make(Kind::kStorage);
  storage->element.dtype = type.element.dtype;
  storage->text = argument(id, 2, Kind::kString).text;
  storage->integer = argument(id, 4, Kind::kInt).integer;
  if (storage->integer < 0) fail("a torch storage of negative size");
  return storage;
}

void Constructors::set_state(Value& object, const Value& state) {
  if (object.kind == Kind::kDict) return;  // attributes of an OrderedDict, such as a state dict's _metadata
  if (object.kind == Kind::kArray) return array_state(object, state);
  if (object.kind == Kind::kDtype) return dtype_state(object, state);
  refuse(std::string("setting the state of a ") + name_of(object.kind) + " in a pickle");
}

void Constructors::dtype_state(Value& dtype, const Value& state) {
  if (state.kind != Kind::kTuple || state.items.size() < 5 || !is_text(*state.items[1])) fail("a damaged numpy dtype");
  for (std::size_t i = 2; i < 5; ++i) {
    if (state.items[i]->kind != Kind::kNone) refuse("structured numpy dtypes in a pickle");
  }
  dtype.element.big_endian = state.items[1]->text == ">";
}

void Constructors::array_state(Value& array, const Value& state) {
  if (array.array) fail("a numpy array that is filled twice");
  if (state.kind != Kind::kTuple || state.items.size() != 5) fail("a damaged numpy array");
  const Value& order = *state.items[3];
  if (order.kind != Kind::kBool && order.kind != Kind::kInt) fail("a damaged numpy array");
  fill_array(array, *state.items[1], argument(state, 2, Kind::kDtype), order.integer != 0, *state.items[4]);
}

void Constructors::fill_array(Value& target, const Value& shape, const Value& dtype, bool fortran, const Value& data) {
  const NpyPlace place{source_.file, place_()};
  const NpyElement& element = dtype.element;
  target.sizes = sizes(shape);
  std::size_t count = 0;
  if (!count_elements(target.sizes, std::max<std::size_t>(element.size, 1), count))
    fail("a numpy array whose shape overflows");
  if (source_.outline && element.kind != NpyElement::Kind::kObject) return;
  if (element.kind == NpyElement::Kind::kNumber) {
    if (!is_text(data)) fail("a numpy array without its bytes");
    spend(data.text.size());
    target.array = std::make_unique<NdArray>(
        decode_npy({element, fortran, target.sizes}, {data.text.begin(), data.text.end()}, place));
    return;
  }
  if (fortran && target.sizes.size() > 1) refuse("object arrays in Fortran order");
  target.kind = Kind::kObjectArray;
  if (element.kind == NpyElement::Kind::kObject) {
    if (data.kind != Kind::kList || data.items.size() != count) fail("an object array of the wrong length");
    spend(count);
    target.items = data.items;
    return;
  }
  if (!is_text(data) || data.text.size() != count * element.size) fail("a text array of the wrong length");
  spend(data.text.size() + count);
  for (std::size_t i = 0; i < count; ++i) {
    target.items.push_back(make(Kind::kString));
    target.items.back()->text = keep(decode_npy_text(element, data.text.substr(i * element.size, element.size), place));
  }
}

}  // namespace anigen::io::pickle
