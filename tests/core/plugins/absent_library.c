void absent_function(void) {}
