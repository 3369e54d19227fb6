"""The batch and the estimate, and how they are kept: EXR files, the store, images for display."""
