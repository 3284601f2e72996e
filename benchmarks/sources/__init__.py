"""What the page on sources is made of: films as phones, recorders and streams give them."""
