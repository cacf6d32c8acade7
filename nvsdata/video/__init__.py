"""Reading videos: their frames, folders of them, and what a folder of recordings was made of."""
