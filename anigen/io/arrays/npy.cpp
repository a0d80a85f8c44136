#include "anigen/io/arrays/npy.h"

#include <algorithm>
#include <cctype>
#include <cstring>
#include <nlohmann/json.hpp>

#include "anigen/core/error.h"

namespace anigen::io {

namespace {

void swap_bytes(std::vector<std::uint8_t>& raw, std::size_t item_size) {
  if (item_size < 2) return;
  for (std::size_t i = 0; i + item_size <= raw.size(); i += item_size) {
    std::reverse(raw.begin() + static_cast<std::ptrdiff_t>(i),
                 raw.begin() + static_cast<std::ptrdiff_t>(i + item_size));
  }
}

std::string descr_of(Dtype dtype, const std::string& name) {
  const DtypeWords& words = words_of(dtype);
  if (words.npy.empty())
    throw Error("array '" + name + "' is bfloat16, which NPY files cannot hold; convert it to float32 first");
  return (words.bytes == 1 ? "|" : "<") + std::string(words.npy);
}

// Row-major copy of column-major elements of item_size bytes. Sizes must agree.
std::vector<std::uint8_t> from_fortran_order(const std::vector<std::uint8_t>& raw,
                                             const std::vector<std::int64_t>& shape, std::size_t item_size) {
  if (shape.size() < 2 || raw.empty()) return raw;
  std::vector<std::uint8_t> out(raw.size());
  const std::size_t rank = shape.size();
  std::vector<std::size_t> stride(rank), index(rank, 0);
  std::size_t step = 1;
  for (std::size_t d = 0; d < rank; ++d) {
    stride[d] = step;
    step *= static_cast<std::size_t>(shape[d]);
  }
  std::size_t source = 0;
  for (std::size_t i = 0; i < step; ++i) {
    std::memcpy(out.data() + i * item_size, raw.data() + source * item_size, item_size);
    for (std::size_t d = rank; d-- > 0;) {
      source += stride[d];
      if (++index[d] < static_cast<std::size_t>(shape[d])) break;
      source -= stride[d] * index[d];
      index[d] = 0;
    }
  }
  return out;
}

}  // namespace

NdArray decode_npy(const NpyHeader& header, std::vector<std::uint8_t> raw, const NpyPlace& place) {
  if (header.element.kind != NpyElement::Kind::kNumber) place.refuse("text or objects as a numeric array");
  std::size_t count = 0;
  if (!count_elements(header.shape, header.element.size, count)) place.fail("its shape overflows");
  if (raw.size() != count * header.element.size) {
    place.fail("its shape needs " + std::to_string(count * header.element.size) + " bytes and " +
               std::to_string(raw.size()) + " are there");
  }
  if (header.element.big_endian) swap_bytes(raw, header.element.size);
  if (header.fortran_order) raw = from_fortran_order(raw, header.shape, header.element.size);
  if (header.element.dtype == Dtype::kBool) {
    for (std::uint8_t& value : raw) value = value != 0;
  }
  return NdArray{header.element.dtype, header.shape, std::move(raw)};
}

std::string encode_npy(const NdArray& array, const std::string& name_for_errors) {
  if (array.bytes.size() != array.count() * size_of(array.dtype)) {
    throw Error("array '" + name_for_errors + "' holds " + std::to_string(array.bytes.size()) +
                " bytes, which is not what its shape says");
  }
  std::string shape = "(";
  for (const std::int64_t size : array.shape) shape += std::to_string(size) + ", ";
  if (array.shape.size() > 1) shape.resize(shape.size() - 2);   // (3, 4)
  if (array.shape.size() == 1) shape.resize(shape.size() - 1);  // (3,)
  std::string header =
      "{'descr': '" + descr_of(array.dtype, name_for_errors) + "', 'fortran_order': False, 'shape': " + shape + "), }";
  constexpr std::size_t kPrefix = 10, kAlignment = 64;
  header.append(kAlignment - (kPrefix + header.size() + 1) % kAlignment, ' ');
  header += '\n';
  std::string bytes("\x93NUMPY\x01\x00", 8);
  bytes += static_cast<char>(header.size() & 0xFF);
  bytes += static_cast<char>(header.size() >> 8);
  bytes += header;
  bytes.append(reinterpret_cast<const char*>(array.bytes.data()), array.bytes.size());
  return bytes;
}

namespace {

/// The Python literals that numpy writes into headers as JSON: other quotes, True and False, tuples, Python 2's long
/// integers, commas before a closing bracket. An escape in a string stays, and no JSON comes of it.
std::string json_of_literal(std::string_view literal) {
  std::string json;
  char quote = 0;
  for (const char c : literal) {
    if (quote != 0 || c == '\'' || c == '"') {
      const bool is_end = quote == 0 || c == quote;
      if (is_end) quote = quote == 0 ? c : 0;
      json += is_end ? std::string(1, '"') : c == '"' || c == '\\' ? "\\x" : std::string(1, c);
    } else if (c == ')' || c == '}' || c == ']') {
      const std::size_t last = json.find_last_not_of(' ');
      if (last != std::string::npos && json[last] == ',') json.resize(last);
      json += c == ')' ? ']' : c;
    } else if (c != 'L') {
      json += c == '(' ? '[' : c == 'T' ? 't' : c == 'F' ? 'f' : c;
    }
  }
  return json;
}

}  // namespace

NpyElement parse_npy_element(std::string_view descr, const NpyPlace& place) {
  const std::string whole(descr);
  NpyElement element;
  if (!descr.empty() && std::string_view("<>|=").find(descr[0]) != std::string_view::npos) {
    element.big_endian = descr[0] == '>';
    descr.remove_prefix(1);
  }
  const char kind = descr.empty() ? '\0' : descr[0];
  std::size_t size = 0;
  bool digits_only = descr.size() > (kind == 'O' ? 0u : 1u) && descr.size() < 12;
  for (std::size_t i = 1; digits_only && i < descr.size(); ++i) {
    digits_only = std::isdigit(static_cast<unsigned char>(descr[i])) != 0;
    size = size * 10 + static_cast<std::size_t>(descr[i] - '0');
  }
  element.size = size;
  if (digits_only && kind == 'O') {
    element.kind = NpyElement::Kind::kObject;
    element.size = 0;
  } else if (digits_only && kind == 'U') {
    element.kind = NpyElement::Kind::kUnicode;
    element.size = 4 * size;  // UCS-4
  } else if (digits_only && kind == 'S') {
    element.kind = NpyElement::Kind::kBytes;
  } else {
    // By its number, for numpy also writes "f04".
    const auto dtype = find_dtype(&DtypeWords::npy, digits_only ? kind + std::to_string(size) : "");
    if (!dtype) place.refuse("numpy dtype '" + whole + "'");
    element.dtype = *dtype;
  }
  return element;
}

NpyHeader parse_npy_header(std::string_view text, std::size_t first_byte, const NpyPlace& place) {
  const std::string where = place.member + ", byte " + std::to_string(first_byte);
  const auto require = [&](bool holds, const std::string& problem) {
    if (!holds) throw InputError(place.file, where, problem);
  };
  using Dict = nlohmann::json;
  const auto limit_depth = [&](int depth, Dict::parse_event_t, Dict&) {
    require(depth <= 4, "the NPY header is nested too deeply");
    return true;
  };
  const Dict json = Dict::parse(json_of_literal(text), limit_depth, false);
  require(json.is_object() && json.size() == 3 && json.contains("descr") && json.contains("fortran_order") &&
              json.contains("shape") && json["fortran_order"].is_boolean() && json["shape"].is_array(),
          "the NPY header is no dict of descr, fortran_order and shape");
  NpyHeader header;
  header.fortran_order = json["fortran_order"];
  if (!json["descr"].is_string()) throw NotSupportedError(place.file, where, "structured NPY dtypes");
  header.element = parse_npy_element(json["descr"].get<std::string>(), place);
  constexpr std::size_t kMaxDimensions = 64;  // numpy's own limit
  require(json["shape"].size() <= kMaxDimensions, "more than 64 dimensions");
  for (const Dict& size : json["shape"]) {
    require(size.is_number(), "expected a size in the NPY header's shape");
    require(size.is_number_unsigned() || !(size.get<double>() < 0), "negative size in the NPY header's shape");
    require(size.is_number_unsigned() && size.get<std::uint64_t>() >> 63 == 0, "a size in the NPY header overflows");
    header.shape.push_back(size);
  }
  return header;
}

bool append_utf8(std::uint32_t character, std::string& text) {
  const auto tail = [&](int shift) { text += static_cast<char>(0x80u | ((character >> shift) & 0x3Fu)); };
  if (character > 0x10FFFF || (character >= 0xD800 && character < 0xE000)) return false;
  if (character < 0x80) {
    text += static_cast<char>(character);
  } else if (character < 0x800) {
    text += static_cast<char>(0xC0u | (character >> 6));
    tail(0);
  } else if (character < 0x10000) {
    text += static_cast<char>(0xE0u | (character >> 12));
    tail(6);
    tail(0);
  } else {
    text += static_cast<char>(0xF0u | (character >> 18));
    tail(12);
    tail(6);
    tail(0);
  }
  return true;
}

std::string decode_npy_text(const NpyElement& element, std::string_view raw, const NpyPlace& place) {
  if (element.kind == NpyElement::Kind::kBytes) {
    const std::size_t last = raw.find_last_not_of('\0');
    return std::string(raw.substr(0, last == std::string_view::npos ? 0 : last + 1));
  }
  std::vector<std::uint32_t> characters(raw.size() / 4);
  for (std::size_t i = 0; i < characters.size(); ++i) {
    for (std::size_t b = 0; b < 4; ++b) {
      const auto byte = static_cast<unsigned char>(raw[4 * i + (element.big_endian ? 3 - b : b)]);
      characters[i] |= static_cast<std::uint32_t>(byte) << (8 * b);
    }
  }
  while (!characters.empty() && characters.back() == 0) characters.pop_back();
  std::string text;
  for (const std::uint32_t character : characters) {
    if (!append_utf8(character, text)) place.fail("text that is not Unicode");
  }
  return text;
}

}  // namespace anigen::io
