#include "anigen/io/arrays/safetensors.h"

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <set>
#include <system_error>
#include <tuple>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/run_folder.h"
#include "anigen/core/text.h"

namespace anigen::io {

namespace {

constexpr std::uint64_t kLengthBytes = 8;
constexpr std::uint64_t kMaxHeaderBytes = 100'000'000;  // the format's own limit
constexpr int kMaxJsonDepth = 8;

/// Sorted keys: with a header of up to 100 MB the linear look-ups of an ordered object would take days.
using Header = nlohmann::json;

using Entry = SafetensorsReader::Entry;

std::string byte(std::uint64_t offset) { return "byte " + std::to_string(offset); }

/// The header's view of one file: turns its JSON into checked entries.
class HeaderReader {
 public:
  HeaderReader(std::string file, std::uint64_t header_bytes, std::uint64_t file_bytes)
      : file_(std::move(file)), data_start_(kLengthBytes + header_bytes), data_bytes_(file_bytes - data_start_) {}

  std::vector<Entry> entries(const Header& header) const {
    std::vector<Entry> entries;
    for (const auto& [name, description] : header.items()) {
      if (name != "__metadata__") entries.push_back(entry(name, description));
    }
    // Stable, so that empty tensors at one offset keep the order of the header.
    std::stable_sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
      return std::pair(a.begin, a.end) < std::pair(b.begin, b.end);
    });
    std::uint64_t expected = 0;
    for (const Entry& entry : entries) {
      if (entry.begin != expected) {
        fail(data_start_ + entry.begin,
             "tensor '" + entry.name + "' " +
                 (entry.begin < expected ? "overlaps the one before it" : "leaves a gap after the one before it"));
      }
      expected = entry.end;
    }
    if (expected != data_bytes_)
      fail(data_start_ + expected, std::to_string(data_bytes_ - expected) + " bytes after the last tensor");
    return entries;
  }

  std::map<std::string, std::string> metadata(const Header& header) const {
    std::map<std::string, std::string> metadata;
    const auto found = header.find("__metadata__");
    if (found == header.end()) return metadata;
    if (!found->is_object()) fail(kLengthBytes, "__metadata__ is not an object");
    for (const auto& [key, value] : found->items()) {
      if (!value.is_string()) fail(kLengthBytes, "__metadata__ entry '" + key + "' is not a string");
      metadata[key] = value.get<std::string>();
    }
    return metadata;
  }

  std::uint64_t data_start() const { return data_start_; }

 private:
  [[noreturn]] void fail(std::uint64_t offset, const std::string& problem) const {
    throw InputError(file_, byte(offset), problem);
  }

  Entry entry(const std::string& name, const Header& description) const {
    const std::string what = "tensor '" + name + "'";
    if (!description.is_object()) fail(kLengthBytes, what + " is not described by an object");
    for (const char* key : {"dtype", "shape", "data_offsets"}) {
      if (!description.contains(key)) fail(kLengthBytes, what + " has no " + key);
    }
    Entry entry;
    entry.name = name;
    entry.array.dtype = dtype(what, description["dtype"]);
    if (!description["shape"].is_array()) fail(kLengthBytes, what + ": shape is not a list");
    for (const Header& size : description["shape"])
      entry.array.shape.push_back(static_cast<std::int64_t>(unsigned_number(what + ": shape", size)));
    const Header& offsets = description["data_offsets"];
    if (!offsets.is_array() || offsets.size() != 2) fail(kLengthBytes, what + ": data_offsets is not a pair");
    entry.begin = unsigned_number(what + ": data_offsets", offsets[0]);
    entry.end = unsigned_number(what + ": data_offsets", offsets[1]);
    if (entry.begin > entry.end || entry.end > data_bytes_) {
      fail(data_start_ + std::min(entry.begin, data_bytes_),
           what + " lies at [" + std::to_string(entry.begin) + ", " + std::to_string(entry.end) + ") of " +
               std::to_string(data_bytes_) + " data bytes; the file is truncated or damaged");
    }
    std::size_t count = 0;
    const std::size_t item = size_of(entry.array.dtype);
    if (!count_elements(entry.array.shape, item, count)) fail(kLengthBytes, what + ": its shape overflows");
    if (count * item != entry.end - entry.begin) {
      fail(data_start_ + entry.begin, what + " needs " + std::to_string(count * item) + " bytes by its shape and has " +
                                          std::to_string(entry.end - entry.begin));
    }
    return entry;
  }

  Dtype dtype(const std::string& what, const Header& code) const {
    if (!code.is_string()) fail(kLengthBytes, what + ": dtype is not a string");
    const auto known = find_dtype(&DtypeWords::safetensors, code.get_ref<const std::string&>());
    if (!known) throw NotSupportedError(file_, what, "dtype " + code.get<std::string>());
    return *known;
  }

  std::uint64_t unsigned_number(const std::string& what, const Header& number) const {
    if (!number.is_number_unsigned() || number.get<std::uint64_t>() > (std::uint64_t{1} << 62)) {
      fail(kLengthBytes,
           what + " holds " + number.dump(-1, ' ', true, Header::error_handler_t::replace) + ", not a plausible size");
    }
    return number.get<std::uint64_t>();
  }

  std::string file_;
  std::uint64_t data_start_, data_bytes_;
};

Header parse_header(const std::string& text, const std::string& file) {
  const auto limit_depth = [&file](int depth, Header::parse_event_t, Header&) {
    if (depth > kMaxJsonDepth) throw InputError(file, byte(kLengthBytes), "the header is nested too deeply");
    return true;
  };
  try {
    return Header::parse(text, limit_depth);
  } catch (const Header::parse_error& error) {
    throw InputError(file, byte(kLengthBytes + error.byte), "the header is not valid JSON");
  } catch (const Header::out_of_range&) {
    throw InputError(file, byte(kLengthBytes), "the header has a number beyond the largest double");
  }
}

std::string header_text(const std::string& file, const NamedArrays& tensors,
                        const std::map<std::string, std::string>& metadata) {
  Json header = Json::object();
  if (!metadata.empty()) header["__metadata__"] = metadata;
  std::set<std::string> names = {"__metadata__"};
  // Text by hand: looking a key up in an ordered object is linear, and checkpoints have thousands of them.
  std::string text = header.dump();
  text.pop_back();
  std::uint64_t offset = 0;
  for (const auto& [name, array] : tensors) {
    if (!names.insert(name).second) throw Error(file + ": tensor name '" + name + "' is taken twice or reserved");
    if (array.bytes.size() != array.count() * size_of(array.dtype)) {
      throw Error(file + ": tensor '" + name + "' holds " + std::to_string(array.bytes.size()) +
                  " bytes, which is not what its shape says");
    }
    const Json description = {{"dtype", words_of(array.dtype).safetensors},
                              {"shape", array.shape},
                              {"data_offsets", {offset, offset + array.bytes.size()}}};
    if (text.size() > 1) text += ",";
    text += Json(name).dump() + ":" + description.dump();
    offset += array.bytes.size();
  }
  text += "}";
  text.resize((text.size() + 7) / 8 * 8, ' ');
  return text;
}

}  // namespace

SafetensorsReader::SafetensorsReader(const std::filesystem::path& path) : path_(path) {
  const std::string file = path.string();
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) throw InputError(file, "", "no such file");
  const std::uint64_t file_bytes = std::filesystem::file_size(path, error);
  in_.open(path, std::ios::binary);
  if (error || !in_) throw InputError(file, "", "cannot be opened");
  if (file_bytes < kLengthBytes) throw InputError(file, byte(file_bytes), "ends inside the header length");
  std::string length(kLengthBytes, '\0');
  in_.read(length.data(), kLengthBytes);
  const std::uint64_t header_bytes = little_endian(length);
  if (header_bytes > kMaxHeaderBytes || header_bytes > file_bytes - kLengthBytes) {
    throw InputError(file, byte(0),
                     "header length " + std::to_string(header_bytes) +
                         " exceeds the file or the format's limit; truncated, or no safetensors file");
  }
  std::string text(header_bytes, '\0');
  in_.read(text.data(), static_cast<std::streamsize>(text.size()));
  if (!in_) throw InputError(file, byte(kLengthBytes), "the header cannot be read");
  if (text.empty() || text[0] != '{') throw InputError(file, byte(kLengthBytes), "the header does not start with '{'");
  const Header header = parse_header(text, file);

  const HeaderReader reader(file, header_bytes, file_bytes);
  metadata_ = reader.metadata(header);
  entries_ = reader.entries(header);
  data_start_ = reader.data_start();
}

std::vector<std::string> SafetensorsReader::names() const {
  std::vector<std::string> names;
  for (const Entry& entry : entries_) names.push_back(entry.name);
  return names;
}

NdArray SafetensorsReader::read(std::size_t index) {
  const Entry& entry = entries_[index];
  NdArray array = entry.array;
  array.bytes.resize(entry.end - entry.begin);
  const std::uint64_t begin = data_start_ + entry.begin;
  in_.seekg(static_cast<std::streamoff>(begin));
  in_.read(reinterpret_cast<char*>(array.bytes.data()), static_cast<std::streamsize>(array.bytes.size()));
  if (!in_) throw InputError(path_.string(), byte(begin), "tensor '" + entry.name + "' cannot be read");
  return array;
}

SafetensorsFile read_safetensors(const std::filesystem::path& path) {
  SafetensorsReader reader(path);
  SafetensorsFile result;
  result.metadata = reader.metadata();
  const std::vector<std::string> names = reader.names();
  for (std::size_t i = 0; i < names.size(); ++i) result.tensors.emplace_back(names[i], reader.read(i));
  return result;
}

std::map<std::string, std::string> read_safetensors_metadata(const std::filesystem::path& path) {
  return SafetensorsReader(path).metadata();
}

void write_safetensors(const std::filesystem::path& path, const NamedArrays& tensors,
                       const std::map<std::string, std::string>& metadata) {
  std::string header;
  try {
    header = header_text(path.string(), tensors, metadata);
  } catch (const Json::exception& error) {
    throw Error(path.string() + ": a tensor name or metadata entry is not UTF-8: " + error.what());
  }
  if (header.size() > kMaxHeaderBytes) throw Error(path.string() + ": the header exceeds the format's limit");
  AtomicFile target(path);
  std::ofstream out(target.temporary(), std::ios::binary);
  for (int shift = 0; shift < 64; shift += 8)
    out.put(static_cast<char>(static_cast<std::uint64_t>(header.size()) >> shift & 0xFF));
  out.write(header.data(), static_cast<std::streamsize>(header.size()));
  for (const auto& [name, array] : tensors)
    out.write(reinterpret_cast<const char*>(array.bytes.data()), static_cast<std::streamsize>(array.bytes.size()));
  out.close();
  if (!out) throw WriteError(path.string() + ": cannot write: " + std::strerror(errno));
  target.commit();
}

namespace {

namespace fs = std::filesystem;

bool contains(const std::string& text, const char* part) { return text.find(part) != std::string::npos; }

std::string contents(const std::vector<std::string>& names) { return names.empty() ? "no checkpoint" : joined(names); }

/// @return the name with the highest step, the first of equals; empty when there is none
std::string newest(const std::vector<std::string>& names, bool ema) {
  std::string best;
  for (const std::string& name : names) {
    const bool state = contains(name, "misc") || name.rfind("state", 0) == 0;
    if (state || contains(name, "ema") != ema) continue;
    if (best.empty() || step_of(name) > step_of(best)) best = name;
  }
  return best;
}

}  // namespace

std::vector<std::string> checkpoint_names(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    const fs::path name = entry->path().filename();
    if (contains(name.string(), ".tmp-")) continue;  // what a killed writer left (core/files.h)
    if (name.extension() == ".pt" || name.extension() == ".safetensors") files.push_back(name);
  }
  if (error) throw InputError(folder.string(), "", "cannot be listed: " + error.message());
  std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
    return std::make_tuple(a.stem().string(), a.extension().string()) <
           std::make_tuple(b.stem().string(), b.extension().string());
  });
  files.erase(std::unique(files.begin(), files.end(),
                          [](const fs::path& a, const fs::path& b) { return a.stem() == b.stem(); }),
              files.end());
  std::vector<std::string> names;
  for (const fs::path& file : files) names.push_back(file.string());
  return names;
}

std::int64_t step_of(const std::string& file_name) {
  constexpr std::string_view kMark = "step";
  constexpr std::size_t kMostDigits = 18;
  const std::size_t mark = file_name.rfind(kMark);
  if (mark == std::string::npos) return -1;
  const std::size_t first = mark + kMark.size();
  const std::string digits = file_name.substr(first, file_name.find('.', first) - first);
  const bool number = !digits.empty() && digits.size() <= kMostDigits &&
                      std::all_of(digits.begin(), digits.end(), [](unsigned char c) { return std::isdigit(c); });
  return number ? std::stoll(digits) : -1;
}

fs::path choose_flow_checkpoint(const fs::path& folder, bool prefer_ema) {
  const fs::path files = RunFolder{folder}.checkpoint_files();
  const std::vector<std::string> names = checkpoint_names(files);
  std::string chosen = newest(names, prefer_ema);
  if (chosen.empty()) {
    chosen = newest(names, !prefer_ema);
    if (chosen.empty()) throw InputError(files.string(), "", "holds no weights, only: " + contents(names));
    log::warn("{}: no {} weights, taking {}", files.string(), prefer_ema ? "moving-average" : "regular", chosen);
  }
  return files / chosen;
}

fs::path choose_checkpoint(const fs::path& folder, const std::string& model, const std::string& name) {
  const fs::path files = RunFolder{folder}.checkpoint_files();
  std::error_code error;
  std::string tried;
  for (const std::string& stem : {model + "_" + name, name}) {
    for (const char* extension : {".pt", ".safetensors"}) {
      const fs::path candidate = files / (stem + extension);
      if (fs::is_regular_file(candidate, error)) return candidate;
      tried += (tried.empty() ? "" : ", ") + candidate.filename().string();
    }
  }
  throw InputError(files.string(), "",
                   "none of " + tried + " is there; it holds: " + contents(checkpoint_names(files)));
}

}  // namespace anigen::io
