#include "anigen/io/fbx/binary.h"

#include <zlib.h>
#include <cstring>
#include <limits>

#include "anigen/core/error.h"

namespace anigen::io::fbx_export {

namespace {

constexpr std::uint32_t kFormatVersion = 7400;
constexpr std::size_t kNullRecord = 13;
// An array shorter than this stays as it is: zlib's header would eat what is won.
constexpr std::size_t kLeastCompressed = 128;

constexpr unsigned char kFileId[] = {0x28, 0xb3, 0x2a, 0xeb, 0xb6, 0x24, 0xcc, 0xc2,
                                     0xbf, 0xc8, 0xb0, 0x2a, 0xa9, 0x2b, 0xfc, 0xf1};
constexpr unsigned char kFooterId[] = {0xfa, 0xbc, 0xab, 0x09, 0xd0, 0xc8, 0xd4, 0x66,
                                       0xb1, 0x76, 0xfb, 0x83, 0x1c, 0xf7, 0x26, 0x7e};
constexpr unsigned char kFileEnd[] = {0xf8, 0x5a, 0x8c, 0x6a, 0xde, 0xf5, 0xd9, 0x7e,
                                      0xec, 0xe9, 0x0c, 0xe3, 0x75, 0x8f, 0x29, 0x0b};

std::string_view bytes_of(const unsigned char (&bytes)[16]) {
  return {reinterpret_cast<const char*>(bytes), sizeof bytes};
}

void append_u32(std::uint32_t value, std::string& out) {
  for (int shift = 0; shift < 32; shift += 8) out += static_cast<char>(value >> shift & 0xFF);
}

void put_u32(std::size_t value, std::size_t offset, std::string& out) {
  for (std::size_t k = 0; k < 4; ++k) out[offset + k] = static_cast<char>(value >> 8 * k & 0xFF);
}

// Little-endian, as the machines that the project runs on.
template <typename T>
void append_number(T value, std::string& out) {
  char bytes[sizeof value];
  std::memcpy(bytes, &value, sizeof value);
  out.append(bytes, sizeof value);
}

/// @return empty where zlib gains nothing
std::string deflated(std::string_view bytes) {
  std::string result(::compressBound(bytes.size()), '\0');
  uLongf size = result.size();
  const int status = ::compress2(reinterpret_cast<Bytef*>(result.data()), &size,
                                 reinterpret_cast<const Bytef*>(bytes.data()), bytes.size(), Z_DEFAULT_COMPRESSION);
  if (status != Z_OK) throw Error("zlib cannot compress an array");
  result.resize(size);
  return result.size() < bytes.size() ? result : std::string();
}

}  // namespace

void Record::begin_property(char type) {
  properties_ += type;
  ++count_;
}

template <typename T>
Record& Record::number(char type, T value) {
  begin_property(type);
  append_number(value, properties_);
  return *this;
}

template <typename T>
Record& Record::numbers(char type, const std::vector<T>& values) {
  begin_property(type);
  const std::string_view plain(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
  const std::string packed = plain.size() < kLeastCompressed ? std::string() : deflated(plain);
  const std::string_view stored = packed.empty() ? plain : std::string_view(packed);
  append_u32(static_cast<std::uint32_t>(values.size()), properties_);
  append_u32(packed.empty() ? 0 : 1, properties_);
  append_u32(static_cast<std::uint32_t>(stored.size()), properties_);
  if (!stored.empty()) properties_.append(stored);
  return *this;
}

Record& Record::flag(bool value) { return number('C', static_cast<char>(value ? 1 : 0)); }
Record& Record::int32(std::int32_t value) { return number('I', value); }
Record& Record::int64(std::int64_t value) { return number('L', value); }
Record& Record::real(double value) { return number('D', value); }
Record& Record::array(const std::vector<std::int32_t>& values) { return numbers('i', values); }
Record& Record::array(const std::vector<std::int64_t>& values) { return numbers('l', values); }
Record& Record::array(const std::vector<float>& values) { return numbers('f', values); }
Record& Record::array(const std::vector<double>& values) { return numbers('d', values); }

Record& Record::text(std::string_view value) {
  begin_property('S');
  append_u32(static_cast<std::uint32_t>(value.size()), properties_);
  properties_.append(value);
  return *this;
}

Record& Record::raw(std::string_view bytes) {
  begin_property('R');
  append_u32(static_cast<std::uint32_t>(bytes.size()), properties_);
  properties_.append(bytes);
  return *this;
}

void Record::append_to(std::string& out) const {
  const std::size_t start = out.size();
  out.append(12, '\0');
  out += static_cast<char>(name_.size());
  out += name_;
  out += properties_;
  for (const Record& inner : children_) inner.append_to(out);
  if (!children_.empty() || count_ == 0 || always_a_list_) out.append(kNullRecord, '\0');
  put_u32(out.size(), start, out);
  put_u32(count_, start + 4, out);
  put_u32(properties_.size(), start + 8, out);
}

std::string_view file_id() { return bytes_of(kFileId); }

std::string file_bytes(const std::list<Record>& records, const std::string& file) {
  std::string out("Kaydara FBX Binary  \0\x1a\0", 23);
  append_u32(kFormatVersion, out);
  for (const Record& record : records) record.append_to(out);
  out.append(kNullRecord, '\0');
  out.append(bytes_of(kFooterId));
  out.append(4, '\0');
  // At least one byte, up to the next multiple of 16.
  out.append(16 - out.size() % 16, '\0');
  append_u32(kFormatVersion, out);
  out.append(120, '\0');
  out.append(bytes_of(kFileEnd));
  if (out.size() > std::numeric_limits<std::uint32_t>::max())
    throw NotSupportedError(file, "", "an FBX file of more than 4 GiB; .glb holds it");
  return out;
}

}  // namespace anigen::io::fbx_export
