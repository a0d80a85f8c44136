#pragma once
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace anigen::io::gltf_import {

/// A JSON text (RFC 8259) and changes to it. Everything that no change names keeps its bytes: the digits of numbers,
/// the escapes of strings, blanks, members that appear twice. Values are named by where they are in the original text,
/// which no change moves.
class JsonText {
 public:
  /// Bytes of a value, without the blanks around it.
  struct Span {
    std::size_t begin = 0, end = 0;
  };

  /// @param text that parse_json() has accepted; must outlive this
  explicit JsonText(std::string_view text);

  Span root() const { return root_; }
  std::string_view text(Span value) const { return text_.substr(value.begin, value.end - value.begin); }

  /// The member of an object, of several by that name the last, as parse_json() takes them.
  std::optional<Span> find(Span object, std::string_view key) const;
  /// As above, of objects within each other; nothing when one of them is missing.
  std::optional<Span> find_below(Span object, const std::vector<std::string_view>& path) const;
  std::vector<Span> elements(Span array) const;

  /// Changes. No two of them may name the same value, or a value and one inside it. Keys are plain: nothing in them
  /// needs an escape. Values are JSON.
  void replace(Span value, std::string by);
  /// Replaces the member, or adds it as the last one.
  void set(Span object, const std::string& key, const std::string& value);
  /// Replaces key and value. @param members one or several as they stand in an object @pre there is such a member
  void replace_member(Span object, std::string_view key, std::string members);
  /// @pre the object has such a member and another one
  void erase(Span object, std::string_view key);
  void append(Span array, const std::vector<std::string>& values);

  /// The text with all changes.
  std::string edited() const;

 private:
  struct Member {
    std::size_t begin;     // of the key's quote
    std::string_view key;  // with quotes, as in the text
    Span value;
  };
  struct Change {
    Span place;
    std::string by;
  };

  std::vector<Member> members(Span object) const;
  void insert_last(Span container, const std::string& items);

  std::string_view text_;
  Span root_;
  std::vector<Change> changes_;
};

}  // namespace anigen::io::gltf_import
