#include "anigen/io/arrays/pickle.h"

#include <array>
#include <unordered_map>
#include <utility>

#include "anigen/io/arrays/pickle_scanner.h"

namespace anigen::io::pickle {

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

  bool step(unsigned char instruction);
  bool step_text(unsigned char instruction);
  bool step_container(unsigned char instruction);
  bool step_object(unsigned char instruction);

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
      if (!step_text(instruction) && !step_container(instruction) && !step_object(instruction)) {
        constructors_.refuse("pickle instruction " + std::to_string(instruction));
      }
  }
  return true;
}

bool Machine::step_text(unsigned char instruction) {
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

Document load(std::string bytes, const Source& source) { return Machine(std::move(bytes), source).run(); }

namespace {

struct AllowedName {
  std::string_view module, name;
  Global global;
};
// numpy 2 renamed its private package to numpy._core; both spellings are in circulation.
constexpr std::array<AllowedName, 14> kAllowed = {
    {{"collections", "OrderedDict", Global::kOrderedDict},
     {"numpy.core.multiarray", "_reconstruct", Global::kNumpyReconstruct},
     {"numpy._core.multiarray", "_reconstruct", Global::kNumpyReconstruct},
     {"numpy.core.multiarray", "scalar", Global::kNumpyScalar},
     {"numpy._core.multiarray", "scalar", Global::kNumpyScalar},
     {"numpy.core.numeric", "_frombuffer", Global::kNumpyFromBuffer},
     {"numpy._core.numeric", "_frombuffer", Global::kNumpyFromBuffer},
     {"numpy", "ndarray", Global::kNumpyArray},
     {"numpy", "dtype", Global::kNumpyDtype},
     {"_codecs", "encode", Global::kCodecsEncode},
     {"torch._utils", "_rebuild_tensor_v2", Global::kRebuildTensor},
     {"torch._utils", "_rebuild_parameter", Global::kRebuildParameter},
     {"torch", "Size", Global::kTorchSize},
     {"torch", "device", Global::kTorchDevice}}};

}  // namespace

bool find_global(std::string_view module, std::string_view name, Global& global, Dtype& dtype) {
  for (const AllowedName& entry : kAllowed) {
    if (entry.module == module && entry.name == name) {
      global = entry.global;
      return true;
    }
  }
  if (module != "torch") return false;
  if (const auto storage = find_dtype(&DtypeWords::torch_storage, name)) {
    global = Global::kTorchStorage;
    dtype = *storage;
    return true;
  }
  const auto named = find_dtype(&DtypeWords::name, name);
  if (!named || words_of(*named).torch_storage.empty()) return false;
  global = Global::kTorchDtype;
  return true;
}

}  // namespace anigen::io::pickle
