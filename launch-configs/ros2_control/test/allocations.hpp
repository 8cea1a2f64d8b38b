// Counts allocations, for tests that an update makes none.
#pragma once

// Calls of operator new by this thread since it began.
long allocations();
