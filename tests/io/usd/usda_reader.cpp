#include "tests/io/usd/usda_reader.h"

#include <cctype>
#include <stdexcept>

namespace anigen::test {

namespace {

class UsdaParser {
 public:
  explicit UsdaParser(std::string_view text) : text_(text) {
    constexpr std::string_view kMagic = "#usda 1.0\n";
    if (text.substr(0, kMagic.size()) != kMagic) fail("no #usda 1.0");
    at_ = kMagic.size();
    next();
  }

  UsdaPrim stage() {
    UsdaPrim stage;
    if (token_ == "(") stage.metadata = block("(", ")");
    while (!token_.empty()) stage.children.push_back(prim());
    return stage;
  }

 private:
  [[noreturn]] void fail(const std::string& problem) const {
    throw std::runtime_error("usda, byte " + std::to_string(at_) + ", at '" + token_ + "': " + problem);
  }

  void next() {
    while (at_ < text_.size() && std::isspace(static_cast<unsigned char>(text_[at_])) != 0) ++at_;
    token_.clear();
    is_text_ = false;
    if (at_ == text_.size()) return;
    const char c = text_[at_];
    if (c == '"' || c == '@' || c == '<') return quoted(c == '<' ? '>' : c);
    constexpr std::string_view kPunctuation = "()[]{}=,";
    if (kPunctuation.find(c) != std::string_view::npos) {
      token_ = text_[at_++];
      return;
    }
    while (at_ < text_.size() && std::isspace(static_cast<unsigned char>(text_[at_])) == 0 &&
           kPunctuation.find(text_[at_]) == std::string_view::npos)
      token_ += text_[at_++];
    if (at_ + 1 < text_.size() && text_.substr(at_, 2) == "[]") {  // of a type
      token_ += "[]";
      at_ += 2;
    }
  }

  void quoted(char end) {
    is_text_ = true;
    for (++at_; at_ < text_.size() && text_[at_] != end; ++at_) {
      if (text_[at_] == '\n') fail("a text does not end");
      if (end == '"' && text_[at_] == '\\') ++at_;
      token_ += text_[at_];
    }
    if (at_ == text_.size()) fail("a text does not end");
    ++at_;
    if (token_.empty()) token_ = " ";  // told from the end of the file
  }

  std::string take() {
    if (token_.empty()) fail("the file ends");
    std::string taken = token_;
    next();
    return taken;
  }

  void expect(const std::string& token) {
    if (is_text_ || token_ != token) fail("expected " + token);
    next();
  }

  /// "key = value" or "type key = value", any number of them.
  std::map<std::string, UsdaValue> block(const std::string& open, const std::string& close) {
    std::map<std::string, UsdaValue> entries;
    expect(open);
    while (token_ != close) {
      std::string key = take();
      while (token_ != "=") key = take();
      expect("=");
      if (!entries.emplace(key, value()).second) fail("a second " + key);
      if (token_ == ",") next();
    }
    expect(close);
    return entries;
  }

  UsdaValue value() {
    UsdaValue result;
    if (!is_text_ && (token_ == "[" || token_ == "(")) {
      const std::string close = token_ == "[" ? "]" : ")";
      next();
      while (token_ != close) {
        result.items.push_back(value());
        if (token_ != close) expect(",");
      }
      expect(close);
      return result;
    }
    if (!is_text_ && token_ == "{") {
      next();
      while (token_ != "}") {
        std::string key = take();
        if (key.back() == ':') {
          key.pop_back();
          if (!result.samples.emplace(std::stod(key), value()).second) fail("a second time " + key);
          expect(",");
        } else {
          while (token_ != "=") key = take();
          expect("=");
          result.items.push_back(value());
        }
      }
      expect("}");
      return result;
    }
    if (!is_text_ && token_.find_first_of(")]},=") != std::string::npos) fail("expected a value");
    result.text = take();
    return result;
  }

  UsdaPrim prim() {
    expect("def");
    UsdaPrim prim;
    prim.type = take();
    prim.name = take();
    if (token_ == "(") prim.metadata = block("(", ")");
    expect("{");
    while (token_ != "}") {
      if (token_ == "def") {
        prim.children.push_back(this->prim());
        continue;
      }
      attribute(prim);
    }
    expect("}");
    return prim;
  }

  void attribute(UsdaPrim& prim) {
    if (token_ == "uniform") next();
    const std::string type = take();
    std::string name = take();
    constexpr std::string_view kSamples = ".timeSamples";
    if (name.size() > kSamples.size() && name.compare(name.size() - kSamples.size(), kSamples.size(), kSamples) == 0)
      name.resize(name.size() - kSamples.size());
    if (prim.types.count(name) != 0) fail("a second " + name);
    prim.types[name] = type;
    UsdaValue& held = prim.attributes[name];
    if (token_ == "=") {
      next();
      held = value();
    }
    if (token_ == "(") prim.details[name] = details();
  }

  std::map<std::string, UsdaValue> details() { return block("(", ")"); }

  std::string_view text_;
  std::size_t at_ = 0;
  std::string token_;
  bool is_text_ = false;
};

void append_numbers(const UsdaValue& value, std::vector<double>& numbers) {
  if (!value.text.empty()) numbers.push_back(value.number());
  for (const UsdaValue& item : value.items) append_numbers(item, numbers);
}

}  // namespace

std::vector<double> UsdaValue::numbers() const {
  std::vector<double> numbers;
  append_numbers(*this, numbers);
  return numbers;
}

std::vector<std::string> UsdaValue::texts() const {
  std::vector<std::string> texts;
  for (const UsdaValue& item : items) texts.push_back(item.text);
  return texts;
}

const UsdaPrim& UsdaPrim::child(const std::string& wanted) const {
  for (const UsdaPrim& one : children) {
    if (one.name == wanted) return one;
  }
  throw std::runtime_error("no prim " + wanted + " in " + name);
}

const UsdaValue& UsdaPrim::operator[](const std::string& attribute) const {
  const auto found = attributes.find(attribute);
  if (found == attributes.end()) throw std::runtime_error("no attribute " + attribute + " in " + name);
  return found->second;
}

UsdaPrim parse_usda(std::string_view text) { return UsdaParser(text).stage(); }

}  // namespace anigen::test
