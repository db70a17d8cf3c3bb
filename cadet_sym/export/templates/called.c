#include "@p@_called.h"

@functions@