"""Parts of tools/make-demo-case."""
