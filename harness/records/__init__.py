"""What is left behind: the contract with `reports`; imports numpy and `scenes.files`."""
