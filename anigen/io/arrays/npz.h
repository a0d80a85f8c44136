#pragma once
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "anigen/io/arrays/ndarray.h"

namespace anigen::io {

/// Reads every array of an NPZ archive (stored or deflated members, NPY versions 1 to 3, C or Fortran order,
/// little or big endian, numeric dtypes). Pickled object arrays become numbers where they can:
///   - ints and None, which public rig datasets use for `parents`: int64 with None as -1; ints and floats: float64;
///   - dicts, lists and arrays inside (Articulation-XL 2.0, docs/reference/riggers.md, 3): one array per number or
///     array found, under dotted keys such as "arr_0.17.vertices"; strings inside are left out, get them from
///     read_npz_objects.
/// Arrays of strings and other objects are refused by name.
/// @throws InputError naming file, member and byte
NamedArrays read_npz(const std::filesystem::path& path);

/// Only these members, so that large files are not read whole. Missing names are an InputError that lists what is
/// there.
NamedArrays read_npz(const std::filesystem::path& path, const std::vector<std::string>& names);

/// Names, dtypes and shapes without the data. Members that do not hold numbers are left out.
NamedArrays read_npz_headers(const std::filesystem::path& path);

/// Atomic; deflated; fixed time stamps, so equal arrays give equal bytes. numpy.load reads it.
/// @throws Error for bfloat16, which numpy has no type for
void write_npz(const std::filesystem::path& path, const NamedArrays& arrays);

/// A Python object as it was pickled into an NPZ member: a tree of dicts and lists with numbers, strings and arrays.
struct NpzValue {
  enum class Kind { kNone, kBool, kInteger, kReal, kString, kArray, kList, kDict };
  Kind kind = Kind::kNone;
  std::int64_t integer = 0;       ///< kInteger, and 0 or 1 for kBool
  double real = 0;                ///< kReal
  std::string text;               ///< kString: UTF-8, or the bytes of a bytes object
  NdArray array;                  ///< kArray
  std::vector<std::string> keys;  ///< kDict: one per item, in order
  std::vector<NpzValue> items;    ///< kList (also tuples, sets, object arrays) and kDict

  /// @return the item of a dict; nullptr when there is none, or when this is no dict
  const NpzValue* find(const std::string& key) const;
};

/// Members as object trees: numeric members are kArray, arrays of text or objects are lists (of lists when they have
/// more dimensions), a 0-d object array is its object. @param names only these members; empty: all
std::vector<std::pair<std::string, NpzValue>> read_npz_objects(const std::filesystem::path& path,
                                                               const std::vector<std::string>& names = {});

/// Limits on the memory that a container may claim. Deflate cannot exceed a ratio of about 1032; real arrays that
/// compress better than max_ratio are small, so larger ones are taken for decompression bombs.
struct ZipLimits {
  std::uint64_t max_members = 4'000'000;
  std::uint64_t max_member_bytes = std::uint64_t{256} << 30;
  double max_ratio = 300;
  std::uint64_t ratio_applies_above = std::uint64_t{256} << 20;  ///< member size in bytes
};

/// One file inside a zip archive.
struct ZipMember {
  std::string name;
  std::uint64_t index = 0;             ///< in the central directory
  std::uint64_t bytes = 0;             ///< declared size after decompression
  std::uint64_t compressed_bytes = 0;  ///< size inside the archive
};

class ZipMemberReader;

/// A zip container opened for reading: stored and deflated members, zip64. Checks of the directory happen at once,
/// of the contents while they are read. @throws InputError naming file and member, NotSupportedError for encryption
/// and other compression methods
class ZipReader {
 public:
  explicit ZipReader(const std::filesystem::path& path, const ZipLimits& limits = {});
  ~ZipReader();
  ZipReader(const ZipReader&) = delete;
  ZipReader& operator=(const ZipReader&) = delete;

  const std::string& file() const { return file_; }
  const std::vector<ZipMember>& members() const { return members_; }
  const ZipMember* find(const std::string& name) const;  ///< nullptr when there is none

  /// All of it; its length is the declared one and its checksum is right.
  std::string read(const ZipMember& member) const;

 private:
  friend class ZipMemberReader;
  struct Handle;
  void check(const ZipMember& member, std::uint16_t method, std::uint16_t encryption) const;

  std::string file_;
  ZipLimits limits_;
  std::unique_ptr<Handle> handle_;
  std::vector<ZipMember> members_;
};

/// Content of one member to write.
struct ZipContent {
  std::string name;
  std::string bytes;
};

/// Writes an archive atomically: deflated members in the order given, all dated 1980-01-01, so that equal input
/// gives equal bytes. @throws Error when the disk refuses or a name is taken twice
void write_zip(const std::filesystem::path& path, const std::vector<ZipContent>& members);

}  // namespace anigen::io
