#pragma once
#include <cstdint>
#include <list>
#include <string>
#include <string_view>
#include <vector>

namespace anigen::io::fbx_export {

/// A record of a binary FBX 7.4 file: name, typed properties, records inside it.
class Record {
 public:
  /// @param name ASCII, at most 255 bytes
  explicit Record(std::string name) : name_(std::move(name)) {}

  /// Appends a record inside this one, which stays where it is. @return it
  Record& child(std::string name) { return children_.emplace_back(std::move(name)); }

  // Each appends one property.
  Record& flag(bool value);              ///< 'C'
  Record& int32(std::int32_t value);     ///< 'I'
  Record& int64(std::int64_t value);     ///< 'L'
  Record& real(double value);            ///< 'D'
  Record& text(std::string_view value);  ///< 'S', UTF-8
  Record& raw(std::string_view bytes);   ///< 'R'
  /// 'i', 'l', 'f', 'd': compressed by zlib when that makes them smaller.
  Record& array(const std::vector<std::int32_t>& values);
  Record& array(const std::vector<std::int64_t>& values);
  Record& array(const std::vector<float>& values);
  Record& array(const std::vector<double>& values);

  /// Ends the list of inner records by a null record also where there is none, as the format wants for some names.
  Record& always_a_list() {
    always_a_list_ = true;
    return *this;
  }

  /// Appends the record's bytes, at the offset that `out` has, to a file that `out` holds from its start.
  void append_to(std::string& out) const;

 private:
  void begin_property(char type);
  template <typename T>
  Record& number(char type, T value);
  template <typename T>
  Record& numbers(char type, const std::vector<T>& values);

  std::string name_, properties_;
  std::uint32_t count_ = 0;
  std::list<Record> children_;
  bool always_a_list_ = false;
};

/// Time in the header of every file: the format derives the file's id and footer from it, and a reader may check them.
inline constexpr std::string_view kCreationTime = "1970-01-01 10:00:00:000";
/// Value of the record "FileId" that belongs to it.
std::string_view file_id();

/// Header, records and footer. Offsets in FBX 7.4 have 32 bits.
/// @throws NotSupportedError when the file would exceed 4 GiB
std::string file_bytes(const std::list<Record>& records, const std::string& file);

/// Ticks of the format in a second.
inline constexpr double kTicksPerSecond = 46186158000.0;

}  // namespace anigen::io::fbx_export
