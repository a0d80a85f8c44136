#pragma once

namespace anigen {

/// Loads the module with everything that needs LibTorch, `anigen-torch.so`, on the first call, and looks up a function
/// in it. The module lies in lib/anigen beside the folder of the program or of the library that this code is in, in
/// `anigen` beside that library, or in either's own folder.
/// @return never null @throws Error naming the file when it cannot be loaded
void* torch_module_entry(const char* function);

}  // namespace anigen
