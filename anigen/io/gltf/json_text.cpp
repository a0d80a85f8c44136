#include "anigen/io/gltf/json_text.h"

#include <algorithm>
#include <utility>

#include "anigen/core/config.h"
#include "anigen/core/text.h"

namespace anigen::io::gltf_import {

namespace {

// Each of these stays inside the text, whatever it holds.

constexpr std::size_t after_blanks(std::string_view text, std::size_t at) {
  while (at < text.size() && (text[at] == ' ' || text[at] == '\t' || text[at] == '\r' || text[at] == '\n')) ++at;
  return at;
}

// @param at the opening quote
constexpr std::size_t after_quotes(std::string_view text, std::size_t at) {
  for (++at; at < text.size(); ++at) {
    if (text[at] == '"') return at + 1;
    if (text[at] == '\\') ++at;
  }
  return text.size();
}

// @param at the value's first byte
constexpr std::size_t after_json_value(std::string_view text, std::size_t at) {
  if (at >= text.size()) return text.size();
  if (text[at] == '"') return after_quotes(text, at);
  if (text[at] != '{' && text[at] != '[') return std::min(text.find_first_of(",]} \t\r\n", at), text.size());
  std::size_t depth = 0;
  while (at < text.size()) {
    const char c = text[at];
    if (c == '"') {
      at = after_quotes(text, at);
      continue;
    }
    ++at;
    if (c == '{' || c == '[') ++depth;
    if ((c == '}' || c == ']') && --depth == 0) return at;
  }
  return text.size();
}

// @param token with quotes
bool is_json_key(std::string_view token, std::string_view key) {
  if (token.find('\\') != std::string_view::npos) return Json::parse(token).get<std::string>() == key;
  return token.size() == key.size() + 2 && token.substr(1, key.size()) == key;
}

}  // namespace

JsonText::JsonText(std::string_view text) : text_(text) {
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  if (text_.substr(0, kByteOrderMark.size()) == kByteOrderMark) text_.remove_prefix(kByteOrderMark.size());
  root_.begin = after_blanks(text_, 0);
  root_.end = after_json_value(text_, root_.begin);
}

std::vector<JsonText::Member> JsonText::members(Span object) const {
  std::vector<Member> result;
  std::size_t at = after_blanks(text_, object.begin + 1);
  while (at + 1 < object.end) {
    Member member;
    member.begin = at;
    at = after_quotes(text_, at);
    member.key = text_.substr(member.begin, at - member.begin);
    member.value.begin = after_blanks(text_, after_blanks(text_, at) + 1);  // behind the colon
    member.value.end = after_json_value(text_, member.value.begin);
    result.push_back(member);
    at = after_blanks(text_, after_blanks(text_, member.value.end) + 1);  // behind the comma or the brace
  }
  return result;
}

std::vector<JsonText::Span> JsonText::elements(Span array) const {
  std::vector<Span> result;
  std::size_t at = after_blanks(text_, array.begin + 1);
  while (at + 1 < array.end) {
    result.push_back({at, after_json_value(text_, at)});
    at = after_blanks(text_, after_blanks(text_, result.back().end) + 1);
  }
  return result;
}

std::optional<JsonText::Span> JsonText::find(Span object, std::string_view key) const {
  std::optional<Span> found;
  for (const Member& member : members(object)) {
    if (is_json_key(member.key, key)) found = member.value;
  }
  return found;
}

std::optional<JsonText::Span> JsonText::find_below(Span object, const std::vector<std::string_view>& path) const {
  std::optional<Span> found = object;
  for (const std::string_view key : path) {
    if (found) found = find(*found, key);
  }
  return found;
}

void JsonText::replace(Span value, std::string by) { changes_.push_back({value, std::move(by)}); }

void JsonText::insert_last(Span container, const std::string& items) {
  const std::size_t end = container.end - 1;
  const bool is_first = after_blanks(text_, container.begin + 1) == end &&
                        std::none_of(changes_.begin(), changes_.end(), [end](const Change& change) {
                          return change.place.begin == end && change.place.end == end;
                        });
  changes_.push_back({{end, end}, (is_first ? "" : ",") + items});
}

void JsonText::set(Span object, const std::string& key, const std::string& value) {
  if (const std::optional<Span> member = find(object, key))
    replace(*member, value);
  else
    insert_last(object, "\"" + key + "\":" + value);
}

void JsonText::replace_member(Span object, std::string_view key, std::string members) {
  std::optional<Span> place;
  for (const Member& member : this->members(object)) {
    if (is_json_key(member.key, key)) place = Span{member.begin, member.value.end};
  }
  if (place) replace(*place, std::move(members));
}

void JsonText::erase(Span object, std::string_view key) {
  const std::vector<Member> all = members(object);
  std::size_t found = all.size();
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (is_json_key(all[i].key, key)) found = i;
  }
  if (found == all.size()) return;
  if (found + 1 < all.size())
    replace({all[found].begin, all[found + 1].begin}, "");
  else if (found > 0)
    replace({all[found - 1].value.end, all[found].value.end}, "");
}

void JsonText::append(Span array, const std::vector<std::string>& values) {
  if (!values.empty()) insert_last(array, joined(values, ","));
}

std::string JsonText::edited() const {
  std::vector<const Change*> order;
  for (const Change& change : changes_) order.push_back(&change);
  std::stable_sort(order.begin(), order.end(),
                   [](const Change* a, const Change* b) { return a->place.begin < b->place.begin; });
  std::string result;
  std::size_t at = 0;
  for (const Change* change : order) {
    result += text_.substr(at, change->place.begin - at);
    result += change->by;
    at = change->place.end;
  }
  return result += text_.substr(at);
}

}  // namespace anigen::io::gltf_import
