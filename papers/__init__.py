"""The papers again: every figure and number from this code, the paper's value beside ours (`surefoot reproduce`)."""
