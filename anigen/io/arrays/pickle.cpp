#include "anigen/io/arrays/pickle.h"

#include <Eigen/Core>
#include <charconv>
#include <unordered_map>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/arrays/pickle_constructors.h"

namespace anigen::io::pickle {

/// Reads instructions and their arguments off the bytes of a pickle; every failure names the byte of the instruction.
class Scanner {
 public:
  Scanner(std::string_view input, const Source& source) : input_(input), source_(source) {}

  unsigned char next_instruction() {
    instruction_ = at_;
    return static_cast<unsigned char>(bytes(1)[0]);
  }

  // Little-endian, 1 to 8 bytes.
  std::uint64_t number(std::size_t size) { return little_endian(bytes(size)); }

  // The next bytes, not copied.
  std::string_view bytes(std::uint64_t count) {
    if (count > input_.size() - at_) fail("the pickle ends early");
    const std::string_view found = input_.substr(at_, count);
    at_ += count;
    return found;
  }

  // Up to the next newline, without it.
  std::string_view line() {
    const std::size_t end = input_.find('\n', at_);
    if (end == std::string_view::npos) fail("the pickle ends early");
    const std::string_view found = input_.substr(at_, end - at_);
    at_ = end + 1;
    return found;
  }

  double big_endian_double() {
    std::uint64_t bits = 0;
    for (const char c : bytes(8)) bits = bits << 8 | static_cast<unsigned char>(c);
    return Eigen::numext::bit_cast<double>(bits);
  }

  // False when it exceeds 64 bits.
  bool parse_decimal(std::string_view line, std::int64_t& integer) {
    const auto [end, error] = std::from_chars(line.data(), line.data() + line.size(), integer);
    if (end != line.data() + line.size() || error == std::errc::invalid_argument) fail("a damaged integer");
    return error == std::errc();
  }

  double parse_float(std::string_view line) {
    double value = 0;
    const auto [end, error] = std::from_chars(line.data(), line.data() + line.size(), value);
    if (end != line.data() + line.size() || error != std::errc()) fail("a damaged number");
    return value;
  }

  // A Python string literal with its quotes.
  std::string unquote(std::string_view line) {
    if (line.size() < 2 || line.front() != line.back() || (line.front() != '\'' && line.front() != '"'))
      fail("a string without quotes");
    line = line.substr(1, line.size() - 2);
    std::string text;
    for (std::size_t i = 0; i < line.size(); ++i) {
      if (line[i] != '\\') {
        text += line[i];
        continue;
      }
      if (++i == line.size()) fail("a damaged escape");
      constexpr std::string_view kEscapes = "\\'\"nrtabfv";
      constexpr std::string_view kMeaning = "\\'\"\n\r\t\a\b\f\v";
      const std::size_t simple = kEscapes.find(line[i]);
      if (simple != std::string_view::npos) {
        text += kMeaning[simple];
      } else if (line[i] == 'x') {
        text += static_cast<char>(digits(line, i + 1, 2, 16));
        i += 2;
      } else {
        text += static_cast<char>(digits(line, i, 3, 8));
        i += 2;
      }
    }
    return text;
  }

  // Python's raw-unicode-escape, to UTF-8.
  std::string unescape_unicode(std::string_view line) {
    std::string text;
    for (std::size_t i = 0; i < line.size(); ++i) {
      std::uint32_t character = static_cast<unsigned char>(line[i]);
      if (line[i] == '\\' && i + 1 < line.size() && (line[i + 1] == 'u' || line[i + 1] == 'U')) {
        const std::size_t count = line[i + 1] == 'u' ? 4 : 8;
        character = digits(line, i + 2, count, 16);
        i += 1 + count;
      }
      if (!append_utf8(character, text)) fail("text that is not Unicode");
    }
    return text;
  }

  void check_utf8(std::string_view text) {
    // Re-encoding what was decoded accepts exactly the shortest forms of real characters.
    for (std::size_t i = 0; i < text.size();) {
      const auto first = static_cast<unsigned char>(text[i]);
      const std::size_t length = first < 0x80 ? 1 : first < 0xE0 ? 2 : first < 0xF0 ? 3 : 4;
      if (length == 1) {
        ++i;
        continue;
      }
      if (first < 0xC0 || i + length > text.size()) fail("text that is not UTF-8");
      std::uint32_t character = first & (0xFFu >> (length + 1));
      for (std::size_t k = 1; k < length; ++k)
        character = character << 6 | (static_cast<unsigned char>(text[i + k]) & 0x3Fu);
      std::string encoded;
      if (!append_utf8(character, encoded) || encoded != text.substr(i, length)) fail("text that is not UTF-8");
      i += length;
    }
  }

  std::string place() const { return source_.member + ", byte " + std::to_string(source_.first_byte + instruction_); }

  [[noreturn]] void fail(const std::string& problem) const { throw InputError(source_.file, place(), problem); }

 private:
  std::uint32_t digits(std::string_view text, std::size_t first, std::size_t count, int base) {
    std::uint32_t value = 0;
    if (first + count > text.size()) fail("a damaged escape");
    const char* begin = text.data() + first;
    if (std::from_chars(begin, begin + count, value, base).ptr != begin + count) fail("a damaged escape");
    return value;
  }

  std::string_view input_;
  const Source& source_;
  std::size_t at_ = 0, instruction_ = 0;
};

/// The stack machine itself. Loops over instructions; nothing recurses.
class Machine {
 public:
  Machine(std::string bytes, Source source)
      : source_(std::move(source)),
        document_(with_input(std::move(bytes))),
        scanner_(*document_.input_, source_),
        constructors_(document_, source_, [this] { return scanner_.place(); }) {
    none_ = constructors_.make(Kind::kNone);
    for (const int truth : {0, 1}) {
      booleans_[truth] = constructors_.make(Kind::kBool);
      booleans_[truth]->integer = truth;
    }
  }

  Document run() {
    while (step(scanner_.next_instruction())) {
    }
    if (stack_.size() != 1 || !marks_.empty()) scanner_.fail("the pickle ends with more or less than one object");
    document_.root_ = stack_.back();
    return std::move(document_);
  }

 private:
  static Document with_input(std::string bytes) {
    Document document;
    document.input_ = std::make_unique<const std::string>(std::move(bytes));
    return document;
  }

  // ---- the stack ----
  void push(Value* value) { stack_.push_back(value); }
  std::size_t bottom() const { return marks_.empty() ? 0 : marks_.back(); }
  Value* pop() {
    if (stack_.size() <= bottom()) scanner_.fail("the pickle takes from an empty stack");
    Value* value = stack_.back();
    stack_.pop_back();
    return value;
  }
  Value* top() {
    if (stack_.size() <= bottom()) scanner_.fail("the pickle takes from an empty stack");
    return stack_.back();
  }
  std::vector<Value*> pop_to_mark() {
    if (marks_.empty()) scanner_.fail("the pickle has no mark to go back to");
    const auto first = stack_.begin() + static_cast<std::ptrdiff_t>(marks_.back());
    std::vector<Value*> items(first, stack_.end());
    stack_.erase(first, stack_.end());
    marks_.pop_back();
    return items;
  }
  Value* pop(Kind kind) {
    Value* value = pop();
    if (value->kind != kind)
      scanner_.fail(std::string("expected a ") + name_of(kind) + ", found a " + name_of(value->kind));
    return value;
  }

  // ---- values ----
  void push_int(std::int64_t integer) {
    push(constructors_.make(Kind::kInt));
    stack_.back()->integer = integer;
  }
  void push_float(double real) {
    push(constructors_.make(Kind::kFloat));
    stack_.back()->real = real;
  }
  void push_text(Kind kind, std::string_view text) {
    if (kind == Kind::kString) scanner_.check_utf8(text);
    push(constructors_.make(kind));
    stack_.back()->text = text;
  }
  void push_items(Kind kind, std::vector<Value*> items) {
    push(constructors_.make(kind));
    stack_.back()->items = std::move(items);
  }
  void push_tuple(std::size_t count) {
    std::vector<Value*> items(count);
    for (std::size_t i = count; i-- > 0;) items[i] = pop();
    push_items(Kind::kTuple, std::move(items));
  }
  void push_long(std::string_view little_endian) {
    if (little_endian.size() > 8) {
      push_text(Kind::kOpaque, "an integer beyond 64 bits");
      return;
    }
    std::uint64_t bits = !little_endian.empty() && (little_endian.back() & 0x80) ? ~std::uint64_t{0} : 0;
    for (std::size_t i = little_endian.size(); i-- > 0;)
      bits = bits << 8 | static_cast<unsigned char>(little_endian[i]);
    push_int(static_cast<std::int64_t>(bits));
  }
  void push_decimal(std::string_view line) {
    if (line == "00" || line == "01") {
      push(booleans_[line == "01"]);
      return;
    }
    std::int64_t integer = 0;
    if (scanner_.parse_decimal(line, integer)) {
      push_int(integer);
    } else {
      push_text(Kind::kOpaque, "an integer beyond 64 bits");
    }
  }

  void extend(Kind kind, const std::vector<Value*>& items, std::size_t group) {
    Value* target = top();
    if (target->kind != kind) scanner_.fail(std::string("adds items to a ") + name_of(target->kind));
    if (items.size() % group != 0) scanner_.fail("a key without a value");
    target->items.insert(target->items.end(), items.begin(), items.end());
  }
  void remember(std::uint64_t key) { memo_[key] = top(); }
  void recall(std::uint64_t key) {
    const auto found = memo_.find(key);
    if (found == memo_.end()) scanner_.fail("refers to memo entry " + std::to_string(key) + ", which does not exist");
    push(found->second);
  }
  std::uint64_t memo_key(std::string_view line) {
    std::int64_t key = 0;
    if (!scanner_.parse_decimal(line, key) || key < 0) scanner_.fail("a damaged memo key");
    return static_cast<std::uint64_t>(key);
  }
  void call() {
    const Value* arguments = pop();
    const Value* function = pop();
    push(constructors_.call(*function, *arguments));
  }

  // One instruction per line reads as the table it is.
  // clang-format off

  /// Numbers and the stack. @return false at STOP
  bool step(unsigned char instruction) {
    switch (instruction) {
      case 0x80: {  // PROTO
        const std::uint64_t protocol = scanner_.number(1);
        if (protocol > 5) constructors_.refuse("pickle protocol " + std::to_string(protocol));
        break;
      }
      case 0x95: scanner_.number(8); break;  // FRAME: a hint for buffered readers
      case '.': return false;
      case '(': marks_.push_back(stack_.size()); break;
      case '0':  // POP, which also removes a mark
        if (!marks_.empty() && stack_.size() == marks_.back()) {
          marks_.pop_back();
        } else {
          pop();
        }
        break;
      case '1': pop_to_mark(); break;
      case '2': push(top()); break;
      case 'N': push(none_); break;
      case 0x88: push(booleans_[1]); break;
      case 0x89: push(booleans_[0]); break;
      case 'I': push_decimal(scanner_.line()); break;
      case 'L': {
        std::string_view line = scanner_.line();
        if (!line.empty() && line.back() == 'L') line.remove_suffix(1);
        push_decimal(line == "00" || line == "01" ? line.substr(1) : line);
        break;
      }
      case 'J': push_int(static_cast<std::int32_t>(scanner_.number(4))); break;
      case 'K': push_int(static_cast<std::int64_t>(scanner_.number(1))); break;
      case 'M': push_int(static_cast<std::int64_t>(scanner_.number(2))); break;
      case 0x8a: push_long(scanner_.bytes(scanner_.number(1))); break;
      case 0x8b: push_long(scanner_.bytes(scanner_.number(4))); break;
      case 'F': push_float(scanner_.parse_float(scanner_.line())); break;
      case 'G': push_float(scanner_.big_endian_double()); break;
      default:
        if (!step_text(instruction) && !step_container(instruction) && !step_object(instruction))
          constructors_.refuse("pickle instruction " + std::to_string(instruction));
    }
    return true;
  }

  bool step_text(unsigned char instruction) {
    switch (instruction) {
      case 'S': push_text(Kind::kBytes, constructors_.keep(scanner_.unquote(scanner_.line()))); break;
      case 'T': push_text(Kind::kBytes, scanner_.bytes(scanner_.number(4))); break;
      case 'U': push_text(Kind::kBytes, scanner_.bytes(scanner_.number(1))); break;
      case 'V': push_text(Kind::kString, constructors_.keep(scanner_.unescape_unicode(scanner_.line()))); break;
      case 'X': push_text(Kind::kString, scanner_.bytes(scanner_.number(4))); break;
      case 0x8c: push_text(Kind::kString, scanner_.bytes(scanner_.number(1))); break;
      case 0x8d: push_text(Kind::kString, scanner_.bytes(scanner_.number(8))); break;
      case 'B': push_text(Kind::kBytes, scanner_.bytes(scanner_.number(4))); break;
      case 'C': push_text(Kind::kBytes, scanner_.bytes(scanner_.number(1))); break;
      case 0x8e:
      case 0x96: push_text(Kind::kBytes, scanner_.bytes(scanner_.number(8))); break;
      default: return false;
    }
    return true;
  }

  bool step_container(unsigned char instruction) {
    switch (instruction) {
      case ']': push_items(Kind::kList, {}); break;
      case 'l': push_items(Kind::kList, pop_to_mark()); break;
      case ')': push_items(Kind::kTuple, {}); break;
      case 't': push_items(Kind::kTuple, pop_to_mark()); break;
      case 0x85: push_tuple(1); break;
      case 0x86: push_tuple(2); break;
      case 0x87: push_tuple(3); break;
      case '}': push_items(Kind::kDict, {}); break;
      case 0x8f: push_items(Kind::kSet, {}); break;
      case 0x91: push_items(Kind::kSet, pop_to_mark()); break;
      case 'd': {
        std::vector<Value*> items = pop_to_mark();
        if (items.size() % 2 != 0) scanner_.fail("a key without a value");
        push_items(Kind::kDict, std::move(items));
        break;
      }
      case 'a': {
        Value* item = pop();
        extend(Kind::kList, {item}, 1);
        break;
      }
      case 'e': extend(Kind::kList, pop_to_mark(), 1); break;
      case 0x90: extend(Kind::kSet, pop_to_mark(), 1); break;
      case 's': {
        Value* item = pop();
        Value* key = pop();
        extend(Kind::kDict, {key, item}, 2);
        break;
      }
      case 'u': extend(Kind::kDict, pop_to_mark(), 2); break;
      default: return false;
    }
    return true;
  }

  bool step_object(unsigned char instruction) {
    switch (instruction) {
      case 'g': recall(memo_key(scanner_.line())); break;
      case 'h': recall(scanner_.number(1)); break;
      case 'j': recall(scanner_.number(4)); break;
      case 'p': remember(memo_key(scanner_.line())); break;
      case 'q': remember(scanner_.number(1)); break;
      case 'r': remember(scanner_.number(4)); break;
      case 0x94: remember(memo_.size()); break;
      case 'c': {
        const std::string_view module = scanner_.line();
        push(constructors_.global(module, scanner_.line()));
        break;
      }
      case 0x93: {
        const Value* name = pop(Kind::kString);
        const Value* module = pop(Kind::kString);
        push(constructors_.global(module->text, name->text));
        break;
      }
      case 'R':
      case 0x81: call(); break;
      case 'b': {
        const Value* state = pop();
        constructors_.set_state(*top(), *state);
        break;
      }
      case 'Q': {
        const Value* id = pop();
        push(constructors_.persistent(*id));
        break;
      }
      default: return false;
    }
    return true;
  }

  // clang-format on

  Source source_;
  Document document_;
  Scanner scanner_;
  Constructors constructors_;
  Value* none_ = nullptr;
  Value* booleans_[2] = {nullptr, nullptr};
  std::vector<Value*> stack_;
  std::vector<std::size_t> marks_;
  std::unordered_map<std::uint64_t, Value*> memo_;
};

Document load(std::string bytes, const Source& source) { return Machine(std::move(bytes), source).run(); }

}  // namespace anigen::io::pickle
