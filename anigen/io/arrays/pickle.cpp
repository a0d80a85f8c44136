#include "anigen/io/arrays/pickle.h"

#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/arrays/pickle_machine.h"

namespace anigen::io::pickle {

namespace {

constexpr std::uint64_t kLongBytes = 4096;  // an outline passes over bytes objects from this length on

}  // namespace

Machine::Machine(std::string bytes, Source source)
    : source_(std::move(source)),
      document_(std::move(bytes)),
      scanner_(*document_.input_, source_),
      constructors_(document_, source_, scanner_.size(), [this] { return scanner_.place(); }) {
  make_constants();
}

Machine::Machine(const ByteSource& bytes, Source source)
    : source_(std::move(source)),
      scanner_(bytes, source_),
      constructors_(document_, source_, scanner_.size(), [this] { return scanner_.place(); }) {
  make_constants();
}

void Machine::make_constants() {
  none_ = constructors_.make(Kind::kNone);
  for (const int truth : {0, 1}) {
    booleans_[truth] = constructors_.make(Kind::kBool);
    booleans_[truth]->integer = truth;
  }
}

Document Machine::run() {
  for (;;) {
    const unsigned char instruction = scanner_.next_instruction();
    before(instruction);
    if (!step(instruction)) break;
  }
  return finish();
}

Document Machine::run_stretch(std::size_t memo_entries) {
  memo_entries_ = memo_entries;
  while (!scanner_.at_end()) {
    if (!step(scanner_.next_instruction())) scanner_.fail("the pickle ends inside an object");
  }
  return finish();
}

Document Machine::finish() {
  if (stack_.size() != 1 || !marks_.empty()) scanner_.fail("the pickle ends with more or less than one object");
  document_.root_ = stack_.back();
  return std::move(document_);
}

Value* Machine::pop() {
  if (stack_.size() <= bottom()) scanner_.fail("the pickle takes from an empty stack");
  Value* value = stack_.back();
  stack_.pop_back();
  return value;
}
Value* Machine::top() {
  if (stack_.size() <= bottom()) scanner_.fail("the pickle takes from an empty stack");
  return stack_.back();
}
std::vector<Value*> Machine::pop_to_mark() {
  if (marks_.empty()) scanner_.fail("the pickle has no mark to go back to");
  const auto first = stack_.begin() + static_cast<std::ptrdiff_t>(marks_.back());
  std::vector<Value*> items(first, stack_.end());
  stack_.erase(first, stack_.end());
  marks_.pop_back();
  return items;
}
Value* Machine::pop(Kind kind) {
  Value* value = pop();
  if (value->kind != kind)
    scanner_.fail(std::string("expected a ") + name_of(kind) + ", found a " + name_of(value->kind));
  return value;
}

/// The bytes in the scanner's window are gone with its next piece.
std::string_view Machine::lasting(std::string_view text) {
  return scanner_.streams() ? constructors_.keep(std::string(text)) : text;
}

void Machine::push_int(std::int64_t integer) {
  push(constructors_.make(Kind::kInt));
  stack_.back()->integer = integer;
}
void Machine::push_float(double real) {
  push(constructors_.make(Kind::kFloat));
  stack_.back()->real = real;
}
void Machine::push_text(Kind kind, std::string_view text) {
  if (kind == Kind::kString) scanner_.check_utf8(text);
  push(constructors_.make(kind));
  stack_.back()->text = lasting(text);
}
void Machine::push_bytes(std::uint64_t count) {
  const bool passed_over = source_.outline && count >= kLongBytes;
  if (passed_over) scanner_.skip(count);
  push_text(Kind::kBytes, passed_over ? std::string_view() : scanner_.bytes(count));
}
void Machine::push_items(Kind kind, std::vector<Value*> items) {
  push(constructors_.make(kind));
  stack_.back()->items = std::move(items);
}
void Machine::push_tuple(std::size_t count) {
  std::vector<Value*> items(count);
  for (std::size_t i = count; i-- > 0;) items[i] = pop();
  push_items(Kind::kTuple, std::move(items));
}
void Machine::push_long(std::string_view little_endian) {
  if (little_endian.size() > 8) {
    push_text(Kind::kOpaque, "an integer beyond 64 bits");
    return;
  }
  std::uint64_t bits = !little_endian.empty() && (little_endian.back() & 0x80) ? ~std::uint64_t{0} : 0;
  for (std::size_t i = little_endian.size(); i-- > 0;) bits = bits << 8 | static_cast<unsigned char>(little_endian[i]);
  push_int(static_cast<std::int64_t>(bits));
}
void Machine::push_decimal(std::string_view line) {
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

void Machine::extend(Kind kind, const std::vector<Value*>& items, std::size_t group) {
  Value* target = top();
  if (target->kind != kind) scanner_.fail(std::string("adds items to a ") + name_of(target->kind));
  if (items.size() % group != 0) scanner_.fail("a key without a value");
  target->items.insert(target->items.end(), items.begin(), items.end());
}
void Machine::recall(std::uint64_t key) {
  const auto found = memo_.find(key);
  Value* value = found == memo_.end() ? remembered_elsewhere(key) : found->second;
  if (value == nullptr) scanner_.fail("refers to memo entry " + std::to_string(key) + ", which does not exist");
  push(value);
}
void Machine::remember(std::uint64_t key) {
  memo_entries_ += memo_.insert_or_assign(key, top()).second;
  remembered(key);
}
std::uint64_t Machine::memo_key(std::string_view line) {
  std::int64_t key = 0;
  if (!scanner_.parse_decimal(line, key) || key < 0) scanner_.fail("a damaged memo key");
  return static_cast<std::uint64_t>(key);
}
void Machine::call() {
  const Value* arguments = pop();
  const Value* function = pop();
  push(constructors_.call(*function, *arguments));
}

// One instruction per line reads as the table it is.
// clang-format off

/// Numbers and the stack. @return false at STOP
bool Machine::step(unsigned char instruction) {
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

bool Machine::step_text(unsigned char instruction) {
  switch (instruction) {
    case 'S': push_text(Kind::kBytes, constructors_.keep(scanner_.unquote(scanner_.line()))); break;
    case 'T': push_bytes(scanner_.number(4)); break;
    case 'U': push_bytes(scanner_.number(1)); break;
    case 'V': push_text(Kind::kString, constructors_.keep(scanner_.unescape_unicode(scanner_.line()))); break;
    case 'X': push_text(Kind::kString, scanner_.bytes(scanner_.number(4))); break;
    case 0x8c: push_text(Kind::kString, scanner_.bytes(scanner_.number(1))); break;
    case 0x8d: push_text(Kind::kString, scanner_.bytes(scanner_.number(8))); break;
    case 'B': push_bytes(scanner_.number(4)); break;
    case 'C': push_bytes(scanner_.number(1)); break;
    case 0x8e:
    case 0x96: push_bytes(scanner_.number(8)); break;
    default: return false;
  }
  return true;
}

bool Machine::step_container(unsigned char instruction) {
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

bool Machine::step_object(unsigned char instruction) {
  switch (instruction) {
    case 'g': recall(memo_key(scanner_.line())); break;
    case 'h': recall(scanner_.number(1)); break;
    case 'j': recall(scanner_.number(4)); break;
    case 'p': remember(memo_key(scanner_.line())); break;
    case 'q': remember(scanner_.number(1)); break;
    case 'r': remember(scanner_.number(4)); break;
    case 0x94: remember(memo_entries_); break;
    case 'c': {
      const std::string module(scanner_.line());
      push(constructors_.global(module, lasting(scanner_.line())));
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

Document load(std::string bytes, const Source& source) { return Machine(std::move(bytes), source).run(); }

}  // namespace anigen::io::pickle
