#pragma once
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/io/gltf/gltf.h"

namespace anigen::io::gltf_import {

/// The parts of the reader and who does what (docs/assets.md has the measurements):
///   container.h  the GLB's header and chunks, each fault with its byte; the JSON (nlohmann, depth and size limited);
///                URIs, paths, base64
///   document.h   every index, range and number of the JSON, each fault with its JSON pointer. tinygltf's own parser
///                is not used for this: it takes wrong types as absent, cuts indices to 32 bits and names no place
///   accessors.h  numbers from bytes; Draco and meshoptimizer decode what is compressed
///   rig.h, primitive.h, mesh.h  one skeleton, one mesh in its bind pose, repairs
/// Pictures are kept as encoded bytes; OpenCV decodes them where one is looked at. export.cpp writes new files,
/// graft.h adds a rig to a copy of one (json_text.h, graft_file.h).

/// A value of a glTF's JSON together with where it is, so that every wrong type, index or number becomes an
/// InputError with a JSON pointer. Refers to the JSON and the file name; both must outlive it.
class JsonPlace {
 public:
  JsonPlace(const Json& value, const std::string& file, std::string pointer = "")
      : value_(&value), file_(&file), pointer_(std::move(pointer)) {}

  const std::string& pointer() const { return pointer_; }
  [[noreturn]] void fail(const std::string& problem) const {
    throw InputError(*file_, pointer_.empty() ? "/" : pointer_, problem);
  }
  [[noreturn]] void not_supported(const std::string& feature) const {
    throw NotSupportedError(*file_, pointer_.empty() ? "/" : pointer_, feature);
  }

  /// Members of an object; find() gives nothing when it is absent. @throws InputError when this is no object
  std::optional<JsonPlace> find(const char* key) const;
  JsonPlace at(const char* key) const;
  std::vector<std::string> keys() const;

  /// Elements of an array. @throws InputError when this is no array
  std::size_t size() const {
    expect(value_->is_array(), "an array");
    return value_->size();
  }
  JsonPlace operator[](std::size_t index) const {
    return JsonPlace((*value_)[index], *file_, pointer_ + "/" + std::to_string(index));
  }

  class Entries;
  /// Elements of an optional array member, for a range-based loop.
  Entries entries(const char* key) const;
  /// An optional member of the optional member "extensions".
  std::optional<JsonPlace> extension(const char* name) const {
    const std::optional<JsonPlace> extensions = find("extensions");
    return extensions ? extensions->find(name) : std::nullopt;
  }

  /// Scalars; a float with an integral value counts as an integer, as JSON knows only numbers.
  std::uint64_t integer(std::uint64_t low, std::uint64_t high) const;
  double number() const;  ///< finite
  std::string string() const {
    expect(value_->is_string(), "a string");
    return value_->get<std::string>();
  }
  bool boolean() const {
    expect(value_->is_boolean(), "true or false");
    return value_->get<bool>();
  }
  /// Exactly `count` finite numbers.
  std::vector<double> numbers(std::size_t count) const;

  /// Optional members with their default.
  std::uint64_t integer_or(const char* key, std::uint64_t fallback, std::uint64_t high) const {
    const std::optional<JsonPlace> member = find(key);
    return member ? member->integer(0, high) : fallback;
  }
  std::string string_or(const char* key, const std::string& fallback) const {
    const std::optional<JsonPlace> member = find(key);
    return member ? member->string() : fallback;
  }
  bool boolean_or(const char* key, bool fallback) const {
    const std::optional<JsonPlace> member = find(key);
    return member ? member->boolean() : fallback;
  }
  /// An optional index into an array of `count` entries; -1 when absent.
  int index_or_none(const char* key, std::size_t count, const char* what) const {
    const std::optional<JsonPlace> member = find(key);
    return member ? member->as_index(count, what) : -1;
  }
  int index(const char* key, std::size_t count, const char* what) const { return at(key).as_index(count, what); }
  /// As above, for the value itself.
  int as_index(std::size_t count, const char* what) const;
  /// Length of an optional array member; 0 when absent.
  std::size_t size_of(const char* key) const {
    const std::optional<JsonPlace> member = find(key);
    return member ? member->size() : 0;
  }

 private:
  void expect(bool fits, const char* wanted) const {
    if (!fits) fail(std::string("expected ") + wanted + ", found " + value_->type_name());
  }

  const Json* value_;
  const std::string* file_;
  std::string pointer_;
};

class JsonPlace::Entries {
 public:
  explicit Entries(std::optional<JsonPlace> list) : list_(std::move(list)), size_(list_ ? list_->size() : 0) {}
  struct Iterator {
    const Entries* entries;
    std::size_t index;
    JsonPlace operator*() const { return (*entries->list_)[index]; }
    void operator++() { ++index; }
    bool operator!=(const Iterator& other) const { return index != other.index; }
  };
  Iterator begin() const { return {this, 0}; }
  Iterator end() const { return {this, size_}; }

 private:
  std::optional<JsonPlace> list_;
  std::size_t size_;
};

inline JsonPlace::Entries JsonPlace::entries(const char* key) const { return Entries(find(key)); }

/// Collects what the importer changed, in the order it happened; one note per kind of change however often it
/// happened, so that a broken file of a million vertices does not report a million times.
class Notes {
 public:
  /// A sentence, once.
  void add(const std::string& code, const std::string& sentence);
  /// Counts; the note reads "<count> <what>", for example "6 vertices with weights that are not numbers".
  void tally(const std::string& code, const std::string& what, std::size_t count = 1);
  /// Sum of the weights of a vertex in the file.
  void weight_sum(double sum) { lowest_weight_sum_ = std::min(lowest_weight_sum_, sum); }
  /// Of all vertices with weights; 1 when there are none, or all sum to more.
  double lowest_weight_sum() const { return lowest_weight_sum_; }
  std::vector<ImportNote> take() const;

  struct Entry {
    std::string code, text;
    std::size_t count;  ///< 0: a sentence
  };
  const std::vector<Entry>& entries() const { return entries_; }

 private:
  std::vector<Entry> entries_;
  double lowest_weight_sum_ = 1.0;
};

/// A .gltf or .glb taken apart: its JSON and its binary chunk. Not copyable, since `binary` points into `bytes`.
struct Container {
  std::string file;              ///< path as the user gave it
  std::filesystem::path folder;  ///< what relative URIs start from
  Json json;
  std::string bytes;        ///< of a .glb; of a .gltf only where its text is kept
  std::string_view text;    ///< of the JSON; empty for a .gltf whose text is not kept
  std::string_view binary;  ///< the BIN chunk
  bool has_binary = false;
  std::string further_chunks;  ///< of a .glb: chunks that glTF does not know, with their headers

  Container() = default;
  Container(const Container&) = delete;
  Container& operator=(const Container&) = delete;
};

/// Reads the file and splits it, by its magic number and not by its name (glTF 2.0, section 4.4: GLB). Git LFS
/// pointers, lengths that disagree with the file, wrong versions, over-deep or over-long JSON are refused.
/// @param keep_text of a .gltf, too @throws InputError with the byte offset
void read_container(const std::filesystem::path& path, const ImportOptions& options, Container& container,
                    bool keep_text = false);

/// Splits a file that is in memory. @param container its `file` and `folder` are set
/// @throws InputError as above
void split_container(std::string bytes, const ImportOptions& options, Container& container, bool keep_text = false);

/// Folder of a file that lies in none: relative URIs are refused there.
const std::filesystem::path& no_folder();

/// A .glb: header, JSON chunk padded by blanks, binary chunk padded by zeros, further chunks as they are (glTF 2.0,
/// section 4.4). @param file for messages @throws NotSupportedError above 4 GiB
std::string glb_bytes(std::string text, std::string_view binary, const std::string& file,
                      std::string_view further_chunks = {});

inline bool is_data_uri(const std::string& uri) { return uri.rfind("data:", 0) == 0; }

/// Content of a data URI, or of a file named by a plain relative path inside `folder`. Everything else is refused
/// before any file is touched: other schemes, absolute paths, parent folders (also percent-encoded), backslashes, NUL.
/// So is a link that leads out of the folder.
/// @param place JSON pointer of the uri, for the message @param max_bytes of the decoded content
/// @throws InputError
std::string read_uri(const std::string& uri, const std::filesystem::path& folder, const std::string& file,
                     const std::string& place, std::uintmax_t max_bytes);

/// The path of the file that a URI names, percent-decoded and checked as above; there may be no such file.
/// @throws InputError
std::filesystem::path path_of_uri(const std::string& uri, const std::filesystem::path& folder, const std::string& file,
                                  const std::string& place);

}  // namespace anigen::io::gltf_import
